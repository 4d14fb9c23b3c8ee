//! Reading ahead: frames are decoded on a thread of their own while earlier ones are mapped.

use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::{Builder, Scope};

use crate::dataset::{Dataset, Loaded, Noise, load_each};
use crate::error::{Error, Result};
use crate::frame::Frame;

/// Decoded frames that wait, at most: enough to smooth out a slow frame, little memory.
const AHEAD: usize = 3;

/// Decodes `indices` in order; ends after the first failure, or when the receiver is dropped.
/// Noise comes with its seed and differs from frame to frame.
pub(super) fn decode<'scope>(
    scope: &'scope Scope<'scope, '_>,
    dataset: &'scope dyn Dataset,
    indices: &'scope [usize],
    with_color: bool,
    noise: Option<(Noise, u32)>,
) -> Result<Receiver<Loaded>> {
    let (sender, receiver) = sync_channel(AHEAD);
    let work = move || {
        let prepare = |index: usize, frame: &mut Frame| {
            if let Some((noise, seed)) = noise {
                noise.apply(&mut frame.depth, seed, index as u32);
            }
        };
        let indices = indices.iter().copied();
        load_each(dataset, indices, with_color, prepare, |loaded| sender.send(loaded).is_ok());
    };
    Builder::new()
        .name("orenx-decode".into())
        .spawn_scoped(scope, work)
        .map_err(|e| Error::Unavailable(format!("cannot start the decoding thread: {e}")))?;
    Ok(receiver)
}
