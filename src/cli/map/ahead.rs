//! Reading ahead: frames are decoded on a thread of their own while earlier ones are mapped.

use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::{Builder, Scope};
use std::time::Instant;

use crate::dataset::{Dataset, Noise};
use crate::error::{Error, Result};
use crate::frame::Frame;

/// Decoded frames that wait, at most: enough to smooth out a slow frame, little memory.
const AHEAD: usize = 3;

/// A frame, or why there is none, and how long that took.
pub(super) struct Decoded {
    pub(super) frame: Result<Frame>,
    pub(super) decode_ms: f32,
}

/// Decodes `indices` in order; ends after the first failure, or when the receiver is dropped.
/// Noise comes with its seed and differs from frame to frame.
pub(super) fn decode<'scope>(
    scope: &'scope Scope<'scope, '_>,
    dataset: &'scope dyn Dataset,
    indices: &'scope [usize],
    noise: Option<(Noise, u32)>,
) -> Result<Receiver<Decoded>> {
    let (sender, receiver) = sync_channel(AHEAD);
    let work = move || {
        for &index in indices {
            let start = Instant::now();
            // No modality that exists reads colour.
            let mut frame = dataset.load(index, false);
            if let (Ok(frame), Some((noise, seed))) = (&mut frame, noise) {
                noise.apply(&mut frame.depth, seed, index as u32);
            }
            let failed = frame.is_err();
            let decode_ms = start.elapsed().as_secs_f32() * 1e3;
            if sender.send(Decoded { frame, decode_ms }).is_err() || failed {
                return;
            }
        }
    };
    Builder::new()
        .name("orenx-decode".into())
        .spawn_scoped(scope, work)
        .map_err(|e| Error::Unavailable(format!("cannot start the decoding thread: {e}")))?;
    Ok(receiver)
}
