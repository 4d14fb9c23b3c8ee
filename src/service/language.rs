//! The verbs of language: what frames say of meaning, and where in a map something is.

use std::sync::Arc;
use std::time::Instant;

use super::find::{
    ClassifyQuestion, ClassifyReply, FindQuestion, FindReply, MAX_CLASSES, check_places,
};
use super::question::demand;
use super::sought::{MAX_PROMPTS, Names, contract};
use super::tasks::{ClassifyTask, FindTask};
use super::{Call, Service};
use crate::encoder::features_of;
use crate::engine::Published;
use crate::error::{Error, Fault, Result};
use crate::frame::{FeatureImage, Frame, LabelImage};
use crate::map::MapView;

impl Service {
    /// The features of an image of classes, by the server's text encoder. May take a while where a
    /// network embeds.
    pub fn embed_labels(&self, labels: &LabelImage) -> Result<FeatureImage> {
        let without = |problem: String| Err(Error::frame(Fault::Encoder, "labels", problem));
        let Some(encoder) = &self.words.encoder else {
            return without("need a text encoder, and the server has none (encoder.kind)".into());
        };
        match features_of(labels, encoder) {
            Err(Error::FailedPrecondition(problem)) => {
                without(problem.trim_start_matches("labels: ").into())
            }
            other => other,
        }
    }

    /// Refuses features of another encoder than the map's, or than the server's: nobody could ask for
    /// them in words.
    pub(super) fn check_contract(&self, frame: &Frame, view: &MapView) -> Result<()> {
        let Some(features) = &frame.features else { return Ok(()) };
        let refuse = |problem| Err(Error::frame(Fault::Encoder, "features.encoder_id", problem));
        if let Some(problem) = view.contract().and_then(|ours| ours.mismatch(&features.contract)) {
            return refuse(problem);
        }
        let ours = self.words.encoder.as_ref().map(|encoder| encoder.contract());
        match ours.filter(|ours| **ours != features.contract) {
            None => Ok(()),
            Some(ours) => refuse(format!(
                "{} numbers of the encoder '{}', but the server's has {} of '{}' (encoder.kind)",
                features.contract.dimension,
                features.contract.encoder_id,
                ours.dimension,
                ours.encoder_id
            )),
        }
    }

    /// The things in the newest view that fit, if it is as new as the question demands; a dropped
    /// future stops the work. `call` says whose times these are.
    pub async fn find(&self, question: FindQuestion, call: Call) -> Result<FindReply> {
        let started = Instant::now();
        let settings = question.settings()?;
        let demands = (question.min_epoch, question.max_age);
        let view = self.view(&question.map_id, demands, started)?;
        let scorer = self.words.scorer(&view, question.sought, Names::of(""), MAX_PROMPTS).await?;
        let encoder_id = contract(&view)?.encoder_id.to_string();
        let (epoch, newest_stamp_ns) = (view.epoch(), view.newest_stamp_ns());
        let (findings, queued) = self.readers.answer(FindTask { view, scorer, settings }).await?;
        check_places(findings.places.points.len(), self.max_points)?;
        let spent = started.elapsed();
        self.times.observe(call, queued, spent);
        Ok(FindReply { findings, encoder_id, epoch, newest_stamp_ns, spent })
    }

    /// The class of each point in the newest view; otherwise as [`Service::find`].
    pub async fn classify(&self, question: ClassifyQuestion, call: Call) -> Result<ClassifyReply> {
        let started = Instant::now();
        question.check(self.max_points)?;
        let demands = (question.min_epoch, question.max_age);
        let view = self.view(&question.map_id, demands, started)?;
        let classes = question.classes.without_negatives();
        let scorer = self.words.scorer(&view, classes, Names::of_classes(), MAX_CLASSES).await?;
        let encoder_id = contract(&view)?.encoder_id.to_string();
        let (epoch, newest_stamp_ns) = (view.epoch(), view.newest_stamp_ns());
        let task = ClassifyTask { view, points: question.points, classes: scorer };
        let ((class, score), queued) = self.readers.answer(task).await?;
        let spent = started.elapsed();
        self.times.observe(call, queued, spent);
        Ok(ClassifyReply { class, score, encoder_id, epoch, newest_stamp_ns, spent })
    }

    /// The newest view of a map, if it is as new as a question demands.
    fn view(
        &self,
        map_id: &str,
        demands: (u64, Option<std::time::Duration>),
        now: Instant,
    ) -> Result<Arc<MapView>> {
        let Published { view, framed_at, .. } = self.map(map_id)?.published();
        let age = framed_at.map(|at| now.saturating_duration_since(at));
        demand(demands, (view.epoch(), age))?;
        Ok(view)
    }
}
