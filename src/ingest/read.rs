//! From messages to frames.

use crate::error::Result;
use crate::service::Service;
use crate::wire::{IncomingFrame, v1};

/// A frame out of its message, with the features of its labels. Takes milliseconds where there are
/// images to decode or names to embed: not for threads that others wait for.
pub(super) fn read_frame(service: &Service, message: v1::Frame) -> Result<IncomingFrame> {
    let mut incoming = IncomingFrame::try_from(message)?;
    if let Some(labels) = incoming.labels.take() {
        incoming.frame.features = Some(service.embed_labels(&labels)?);
    }
    Ok(incoming)
}
