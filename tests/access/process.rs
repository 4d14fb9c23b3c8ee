//! The program as a server, for what only a process has: signals and a log.

use std::io::{BufRead, BufReader, Lines};
use std::process::{Child, ChildStderr, ChildStdout, Command, Stdio};

/// A server as a process, and what it writes to stderr.
pub(super) struct Process {
    child: Child,
    said: Lines<BufReader<ChildStderr>>,
    /// Kept open: a program that cannot print ends.
    _printed: Lines<BufReader<ChildStdout>>,
    pub(super) grpc: String,
}

impl Process {
    pub(super) fn start(arguments: &[String]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_orenx"))
            .arg("serve")
            .args(["--set", "storage.path=", "--set", "server.grpc=127.0.0.1:0"])
            .args(["--set", "server.http="])
            .args(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut printed = BufReader::new(child.stdout.take().unwrap()).lines();
        let line = printed.next().expect("a line").unwrap();
        let grpc = line.split("://").nth(1).expect("an address").to_owned();
        let said = BufReader::new(child.stderr.take().unwrap()).lines();
        Self { child, said, _printed: printed, grpc }
    }

    pub(super) fn signal(&self, name: &str) {
        let pid = self.child.id().to_string();
        assert!(Command::new("kill").args([name, &pid]).status().unwrap().success());
    }

    /// Waits for a line with `part`, and returns it.
    pub(super) fn hear(&mut self, part: &str) -> String {
        let mut lines = self.said.by_ref().map(|line| line.unwrap());
        lines.find(|line| line.contains(part)).unwrap_or_else(|| panic!("it never said '{part}'"))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
