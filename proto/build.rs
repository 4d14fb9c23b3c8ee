//! Generates messages, clients and servers from the `.proto` files, in pure Rust (no protoc), and takes
//! in the dashboard.

#[path = "../clients/web/build/embed.rs"]
mod embed;

use std::error::Error;
use std::path::PathBuf;

const FILES: [&str; 10] = [
    "orenx/v1/admin.proto",
    "orenx/v1/geometry.proto",
    "orenx/v1/ingest.proto",
    "orenx/v1/language.proto",
    "orenx/v1/maps.proto",
    "orenx/v1/mirror.proto",
    "orenx/v1/planner.proto",
    "orenx/v1/query.proto",
    "orenx/v1/render.proto",
    "orenx/v1/snapshots.proto",
];

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=proto");
    println!("cargo::rerun-if-changed=clients/web/build/embed.rs");
    let mut compiler = protox::Compiler::new(["proto"])?;
    compiler.include_imports(true).include_source_info(true).open_files(FILES)?;
    // What reflection tells, comments included.
    let out = PathBuf::from(std::env::var("OUT_DIR")?);
    std::fs::write(out.join("orenx.v1.bin"), compiler.encode_file_descriptor_set())?;
    embed::dashboard(&out)?;
    // The same of a frame alone, short, for the files of the journal.
    let mut frame = protox::Compiler::new(["proto"])?;
    frame.include_imports(true).open_file("orenx/v1/ingest.proto")?;
    std::fs::write(out.join("orenx.v1.Frame.bin"), frame.encode_file_descriptor_set())?;
    // What does not decode is the sender's fault: `wire` has a codec that says so.
    tonic_prost_build::configure()
        .codec_path("crate::wire::Messages")
        .compile_fds(compiler.file_descriptor_set())?;
    Ok(())
}
