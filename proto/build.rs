//! Generates messages, clients and servers from the `.proto` files, in pure Rust (no protoc).

use std::error::Error;

const FILES: [&str; 4] = [
    "orenx/v1/geometry.proto",
    "orenx/v1/ingest.proto",
    "orenx/v1/maps.proto",
    "orenx/v1/query.proto",
];

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=proto");
    let descriptors = protox::compile(FILES, ["proto"])?;
    // What does not decode is the sender's fault: `wire` has a codec that says so.
    tonic_prost_build::configure().codec_path("crate::wire::Messages").compile_fds(descriptors)?;
    Ok(())
}
