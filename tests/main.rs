//! The one integration-test binary: one line a module, with what it is for.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stderr,
    reason = "a test reports by panicking, and says on stderr what it skips"
)]

mod access; // keys and roles, TLS, limits of one client
mod ask_command; // what `orenx ask` and `orenx classify` find, draw and refuse
mod bad_files; // damaged maps, points, recordings and settings on the command line
mod bench_command; // what `orenx bench serve` and `planner` measure
mod dashboard; // the page in a browser: it grows, answers, and survives a killed server
mod edit_command; // `orenx edit`, and `--map` of what asks a server
mod eval_language; // what `orenx eval` says of classes in a labelled house
mod fuzz; // what the fuzzer found, read once more
mod house; // the rules of the house held against its files: floors, names, sizes
mod http; // the same server over HTTP: probes, answers, bad input, the document
mod map_command; // what `orenx map` says to bad input
mod mapping; // the promises of a map against closed-form scenes
mod planner_command; // `orenx planner` on a file and on the server that loaded it
mod recordings; // real recordings through the readers
mod render_command; // `orenx render` and the images of `orenx eval`
mod server; // a server on a free port: frames, questions, bad input, the way down
mod support; // where recorded data is, and what a test without it says
