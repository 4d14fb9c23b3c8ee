//! The dashboard in a real browser, against the real program: a script for Node.js drives both.

use std::path::Path;
use std::process::Command;

/// Where the browser is, from `ORENX_TEST_BROWSER`; `make test` installs one, builds the page and says
/// where. A test without it says that it is skipped.
#[test]
fn the_page_shows_a_map_that_grows_and_answers() {
    let Some(browser) = std::env::var_os("ORENX_TEST_BROWSER") else {
        eprintln!(
            "skipped: the_page_shows_a_map_that_grows_and_answers: ORENX_TEST_BROWSER is not set"
        );
        return;
    };
    let encoder = std::env::var_os("ORENX_TEST_ENCODERS").map(|all| Path::new(&all).join("static"));
    let encoder = encoder.filter(|folder| folder.is_dir()).unwrap_or_default();
    let output = Command::new("node")
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("clients/web"))
        .arg("tests/browser/run.mjs")
        .env("CHROMIUM", browser)
        .env("PROGRAM", env!("CARGO_BIN_EXE_orenx"))
        .env("ENCODER", encoder)
        .output()
        .expect("node");
    let said = [output.stdout, output.stderr].map(|s| String::from_utf8_lossy(&s).into_owned());
    let said = said.concat();
    eprint!("{said}");
    assert!(output.status.success() && said.contains(" passed, 0 failed"), "{said}");
}
