//! The fuzzer: runs the target that `ORENX_FUZZ` names, and without one tells which there are.
#![no_main]
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "a target reports by panicking, and its list goes to stdout"
)]

mod bound;
mod mutate;

#[path = "../bodies/mod.rs"]
mod bodies;

use std::path::Path;
use std::process::exit;
use std::sync::OnceLock;

use bodies::{TARGETS, Target};
use libfuzzer_sys::{fuzz_mutator, fuzz_target};

fn target() -> &'static Target {
    static TARGET: OnceLock<&Target> = OnceLock::new();
    TARGET.get_or_init(|| {
        let name = std::env::var("ORENX_FUZZ").unwrap_or_default();
        TARGETS.iter().find(|target| target.name == name).unwrap_or_else(|| {
            TARGETS.iter().for_each(|target| println!("{}", target.name));
            exit(i32::from(!name.is_empty()));
        })
    })
}

/// Writes the good inputs of the target into the folder of `ORENX_FUZZ_SEEDS`, and beside it how long an
/// input may be.
fn begin() {
    let target = target();
    let Some(folder) = std::env::var_os("ORENX_FUZZ_SEEDS") else { return };
    let folder = Path::new(&folder);
    std::fs::create_dir_all(folder).unwrap();
    for (number, seed) in (target.seeds)().iter().enumerate() {
        std::fs::write(folder.join(format!("seed-{number:02}")), seed).unwrap();
    }
    std::fs::write(folder.with_extension("longest"), target.longest.to_string()).unwrap();
    exit(0);
}

fuzz_target!(init: begin(), |input: &[u8]| {
    (target().read)(input);
});

fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
    mutate::mutate(target().layout, data, size, max_size, seed)
});
