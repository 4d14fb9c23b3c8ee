//! Loading a sequence in order, for a thread of its own.

use std::time::Instant;

use super::Dataset;
use crate::error::Result;
use crate::frame::Frame;

/// A frame, or why there is none, and how long that took.
pub struct Loaded {
    pub frame: Result<Frame>,
    pub decode_ms: f32,
}

/// Loads the frames `indices` in order and hands each to `deliver`, until that says that nobody
/// listens (`false`) or after a frame that cannot be read. `prepare` has the last word on each, and may refuse it.
pub fn load_each(
    dataset: &dyn Dataset,
    indices: impl IntoIterator<Item = usize>,
    with_color: bool,
    mut prepare: impl FnMut(usize, &mut Frame) -> Result<()>,
    mut deliver: impl FnMut(Loaded) -> bool,
) {
    for index in indices {
        let start = Instant::now();
        let frame = dataset.load(index, with_color).and_then(|mut frame| {
            prepare(index, &mut frame)?;
            Ok(frame)
        });
        let failed = frame.is_err();
        let decode_ms = start.elapsed().as_secs_f32() * 1e3;
        if !deliver(Loaded { frame, decode_ms }) || failed {
            return;
        }
    }
}
