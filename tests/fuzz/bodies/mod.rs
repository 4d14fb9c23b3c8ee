//! What a fuzz target does with its input, and good inputs to begin with. The fuzzer runs these, and so
//! does an ordinary test, on every input that is kept.
//!
//! A body has nothing to say: it fails by panicking, by never ending, or by taking too much memory.

mod ask;
mod cdr;
mod files;
mod http;
mod images;
mod journal;
mod maps;
mod mirror;
mod questions;
mod scene;
mod server;
mod wire;

/// How an input is laid out, for who changes it and wants it to be looked at still.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Layout {
    /// Bytes.
    Plain,
    /// So many bytes, and a message of Protobuf.
    Protobuf(usize),
    /// Sections with their checksums.
    Map,
    /// Records, of which chunks have checksums.
    Mcap,
    /// A byte, and an image whose chunks have checksums if it is a PNG.
    Image,
}

/// A reader of what comes from outside.
pub(crate) struct Target {
    pub(crate) name: &'static str,
    /// Reads an input, and uses what was read; whether all of it was good.
    pub(crate) read: fn(&[u8]) -> bool,
    /// Good inputs.
    pub(crate) seeds: fn() -> Vec<Vec<u8>>,
    #[allow(dead_code, reason = "tests change no input")]
    pub(crate) layout: Layout,
    /// The longest input that is tried, bytes.
    pub(crate) longest: usize,
}

/// All of them.
pub(crate) const TARGETS: [Target; 9] = [
    wire::TARGET,
    ask::TARGET,
    http::TARGET,
    cdr::TARGET,
    images::TARGET,
    journal::TARGET,
    maps::TARGET,
    mirror::TARGET,
    files::TARGET,
];

/// An input that begins with a byte that says of which kind it is.
fn of_kind(kind: usize, rest: &[u8]) -> Vec<u8> {
    [&[kind as u8], rest].concat()
}

/// The kind that an input says, of so many that there are, and the rest.
fn kind_of(input: &[u8], kinds: usize) -> Option<(usize, &[u8])> {
    let (kind, rest) = input.split_first()?;
    Some((usize::from(*kind) % kinds, rest))
}
