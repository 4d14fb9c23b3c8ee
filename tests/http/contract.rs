//! The document that describes HTTP, judged by tools that know nothing of the code.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::get;
use crate::server::images::mapped;

/// Requests for each operation.
const EXAMPLES: &str = "40";

/// The folder of the tools, from `ORENX_TEST_TOOLS`; `make test` installs them and says where. A test
/// without them says that it is skipped.
fn tools(test: &str) -> Option<PathBuf> {
    let tools = std::env::var_os("ORENX_TEST_TOOLS").map(PathBuf::from);
    if tools.is_none() {
        eprintln!("skipped: {test}: ORENX_TEST_TOOLS is not set");
    }
    tools
}

/// What a tool says; it must be content.
fn run(command: &mut Command) {
    let output = command.output().unwrap_or_else(|e| panic!("{command:?}: {e}"));
    let said = [output.stdout, output.stderr].map(|s| String::from_utf8_lossy(&s).into_owned());
    assert!(output.status.success(), "{command:?}\n{}", said.concat());
}

#[tokio::test(flavor = "multi_thread")]
async fn the_document_is_valid_and_schemathesis_finds_nothing() {
    let Some(tools) = tools("the_document_is_valid_and_schemathesis_finds_nothing") else { return };
    let server = mapped().await;
    let folder = tempfile::tempdir().unwrap();
    let document = folder.path().join("openapi.json");
    let url = format!("http://{}", server.http);
    std::fs::write(&document, get(&server.http, "/openapi.json").await.body).unwrap();
    let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/http");
    let tried = tokio::task::spawn_blocking(move || {
        run(Command::new(tools.join("python"))
            .args(["-m", "openapi_spec_validator", "--schema", "3.1"])
            .arg(&document));
        run(Command::new(tools.join("schemathesis"))
            .current_dir(folder.path())
            .arg("--config-file")
            .arg(here.join("schemathesis.toml"))
            .args(["run", "--url", &url, "--max-examples", EXAMPLES, "--seed", "1"])
            .arg(&document));
    });
    tried.await.unwrap();
    assert_eq!(get(&server.http, "/readyz").await.status, 200);
    server.stop().await.0.unwrap();
}
