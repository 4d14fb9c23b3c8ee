//! A server of this build, on ports of its own.

use std::process::Stdio;

use tokio::io::{AsyncBufReadExt, BufReader, Lines};
use tokio::process::{Child, ChildStdout, Command};

use crate::error::{Error, Result};

/// A running `orenx serve`, in memory; killed when dropped.
pub(in crate::cli::bench) struct ServerProcess {
    child: Child,
    /// Kept, so that the server has somewhere to write.
    lines: Lines<BufReader<ChildStdout>>,
    grpc: String,
    http: String,
}

impl ServerProcess {
    /// Starts it and waits until it says where it serves.
    pub(in crate::cli::bench) async fn start() -> Result<Self> {
        let failed = |problem: String| Error::Internal(format!("the server to measure: {problem}"));
        let program = std::env::current_exe().map_err(|e| failed(e.to_string()))?;
        let settings = ["server.grpc=127.0.0.1:0", "server.http=127.0.0.1:0", "storage.path="];
        let mut child = Command::new(program)
            .arg("serve")
            .args(settings.iter().flat_map(|setting| ["--set", setting]))
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .kill_on_drop(true)
            .spawn()
            .map_err(|e| failed(e.to_string()))?;
        let stdout = child.stdout.take().ok_or_else(|| failed("has no output".into()))?;
        let mut lines = BufReader::new(stdout).lines();
        let (mut grpc, mut http) = (None, None);
        while grpc.is_none() || http.is_none() {
            let line = lines.next_line().await.map_err(|e| failed(e.to_string()))?;
            let line = line.ok_or_else(|| failed("ended before it served".into()))?;
            let address = line.rsplit(' ').next().unwrap_or_default().to_owned();
            if address.starts_with("grpc://") {
                grpc = Some(address);
            } else if address.starts_with("http://") {
                http = Some(address);
            }
        }
        let (grpc, http) = (grpc.unwrap_or_default(), http.unwrap_or_default());
        Ok(Self { child, lines, grpc, http })
    }

    pub(in crate::cli::bench) fn grpc(&self) -> &str {
        &self.grpc
    }

    pub(in crate::cli::bench) fn http(&self) -> &str {
        &self.http
    }

    /// Ends it. It keeps nothing, so there is nothing to wait for but its end.
    pub(in crate::cli::bench) async fn stop(self) -> Result<()> {
        let Self { mut child, lines, .. } = self;
        drop(lines);
        child.kill().await.map_err(|e| Error::Internal(format!("the server to measure: {e}")))
    }
}
