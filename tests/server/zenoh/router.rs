//! A Zenoh router as a child process: this test binary itself, called for one test that is no test.

use std::io::{BufRead, BufReader, Lines, Read};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};

use serde_json::{Value, json};
use tempfile::TempDir;

/// The variable that makes the child a router: the path of its configuration.
const CONFIG: &str = "ZENOH_ROUTER_OF_TESTS";
const NAME: &str = "server::zenoh::router::is_a_router_where_a_test_starts_it_as_one";
const UP: &str = "the router is up";

/// A router that can be killed and started again, at the same endpoint.
pub(super) struct Router {
    folder: TempDir,
    endpoint: String,
    child: Option<Child>,
    /// What it prints; without a reader it would not get to its end.
    _printed: Option<Lines<BufReader<ChildStdout>>>,
}

impl Router {
    pub(super) fn start() -> Self {
        Self::with("tcp/127.0.0.1", json!({}), |_| {})
    }

    /// `prepare` puts files beside the configuration.
    pub(super) fn with(at: &str, transport: Value, prepare: impl FnOnce(&Path)) -> Self {
        let folder = tempfile::tempdir().unwrap();
        prepare(folder.path());
        let endpoint = format!("{at}:{}", free_port());
        let config = json!({
            "mode": "router",
            "listen": { "endpoints": [endpoint] },
            "scouting": { "multicast": { "enabled": false } },
            "transport": transport,
        });
        std::fs::write(folder.path().join("router.json5"), config.to_string()).unwrap();
        let mut router = Self { folder, endpoint, child: None, _printed: None };
        router.restart();
        router
    }

    pub(super) fn endpoint(&self) -> &str {
        &self.endpoint
    }

    pub(super) fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// As a client's URL.
    pub(super) fn url(&self) -> String {
        let (protocol, address) = self.endpoint.split_once('/').unwrap();
        format!("zenoh+{protocol}://{address}")
    }

    /// Host and port alone.
    pub(super) fn address(&self) -> &str {
        self.endpoint.split_once('/').unwrap().1
    }

    /// Ends it as a power cut would.
    pub(super) fn kill(&mut self) {
        if let Some(mut child) = self.child.take() {
            child.kill().unwrap();
            child.wait().unwrap();
        }
    }

    /// Starts it, and returns when it listens.
    pub(super) fn restart(&mut self) {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", NAME, "--nocapture"])
            .env(CONFIG, self.folder.path().join("router.json5"))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let is_up = lines.any(|line| line.unwrap().contains(UP));
        (self.child, self._printed) = (Some(child), Some(lines));
        assert!(is_up, "the router did not start");
    }
}

impl Drop for Router {
    fn drop(&mut self) {
        self.kill();
    }
}

/// A port that was free a moment ago: the router must have the same one again after a restart.
fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// In the child: a router until its standard input ends, which it does with the test at the latest.
/// Anywhere else: nothing.
#[test]
fn is_a_router_where_a_test_starts_it_as_one() {
    let Some(path) = std::env::var_os(CONFIG).map(PathBuf::from) else { return };
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let config = zenoh::Config::from_file(path).unwrap();
        let _session = zenoh::open(config).await.unwrap();
        println!("{UP}");
        let waiting = tokio::task::spawn_blocking(|| std::io::stdin().read_to_end(&mut Vec::new()));
        waiting.await.unwrap().unwrap();
    });
}
