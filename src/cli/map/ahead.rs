//! Reading ahead: frames are decoded on a thread of their own while earlier ones are mapped.

use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::{Builder, Scope};

use super::Feed;
use crate::dataset::{Loaded, load_each};
use crate::encoder::features_of;
use crate::error::{Error, Result};
use crate::frame::Frame;

/// Decoded frames that wait, at most: enough to smooth out a slow frame, little memory.
const AHEAD: usize = 3;

/// Decodes the frames of `feed` in order; ends after the first failure, or when the receiver is
/// dropped. Noise has `seed` and differs from frame to frame.
pub(super) fn decode<'scope>(
    scope: &'scope Scope<'scope, '_>,
    feed: &'scope Feed<'_>,
    with_color: bool,
    seed: u32,
) -> Result<Receiver<Loaded>> {
    let (sender, receiver) = sync_channel(AHEAD);
    let work = move || {
        let prepare = |index: usize, frame: &mut Frame| {
            if let Some(noise) = feed.noise {
                noise.apply(&mut frame.depth, seed, index as u32);
            }
            if let Some(encoder) = feed.encoder
                && let Some(labels) = feed.dataset.labels(index)?
            {
                frame.features = Some(features_of(&labels, encoder)?);
            }
            Ok(())
        };
        let indices = feed.indices.iter().copied();
        let deliver = |loaded: Loaded| sender.send(loaded).is_ok();
        load_each(feed.dataset, indices, with_color, prepare, deliver);
    };
    Builder::new()
        .name("orenx-decode".into())
        .spawn_scoped(scope, work)
        .map_err(|e| Error::Unavailable(format!("cannot start the decoding thread: {e}")))?;
    Ok(receiver)
}
