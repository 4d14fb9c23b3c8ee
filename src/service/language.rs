//! What frames say of meaning: names of classes become features, and features have one encoder.

use super::Service;
use crate::encoder::features_of;
use crate::error::{Error, Fault, Result};
use crate::frame::{FeatureImage, Frame, LabelImage};

impl Service {
    /// The features of an image of classes, by the server's text encoder. May take a while where a
    /// network embeds.
    pub fn embed_labels(&self, labels: &LabelImage) -> Result<FeatureImage> {
        let without = |problem: String| Err(Error::frame(Fault::Encoder, "labels", problem));
        let Some(encoder) = &self.encoder else {
            return without("need a text encoder, and the server has none (encoder.kind)".into());
        };
        match features_of(labels, encoder) {
            Err(Error::FailedPrecondition(problem)) => {
                without(problem.trim_start_matches("labels: ").into())
            }
            other => other,
        }
    }

    /// Refuses features that could not be asked for in the words of the server's encoder.
    pub(super) fn check_contract(&self, frame: &Frame) -> Result<()> {
        let Some((features, encoder)) = frame.features.as_ref().zip(self.encoder.as_ref()) else {
            return Ok(());
        };
        let (theirs, ours) = (&features.contract, encoder.contract());
        if theirs == ours {
            return Ok(());
        }
        let problem = format!(
            "{} numbers of the encoder '{}', but the server's has {} of '{}' (encoder.kind)",
            theirs.dimension, theirs.encoder_id, ours.dimension, ours.encoder_id
        );
        Err(Error::frame(Fault::Encoder, "features.encoder_id", problem))
    }
}
