//! Questions for things and for the classes of places, and their answers.

use std::time::Duration;

use glam::Vec3;

use super::question::check_points;
use super::sought::Sought;
use super::{DEFAULT_MAP, Service};
use crate::error::{Error, Result};
use crate::frame::Contract;
use crate::geometry::Aabb;
use crate::map::{FindSettings, Findings};

/// Matches of an answer at most.
pub const MAX_MATCHES: usize = 1000;
/// Matches where the question does not say.
const MATCHES: usize = 10;
/// The least score where the question does not say: neither is more likely, and what even a small
/// encoder gives to a fair description.
const LEAST_RELEVANCY: f32 = 0.5;
const LEAST_COSINE: f32 = 0.1;
/// Classes of a question at most, and scores that it takes.
pub const MAX_CLASSES: usize = 4096;
pub const MAX_CLASS_SCORES: usize = 1 << 26;

/// What a client looks for in the whole map. Nothing in it is checked before [`Service::find`] sees
/// it.
#[derive(Debug, Clone, PartialEq)]
pub struct FindQuestion {
    pub map_id: String,
    pub sought: Sought,
    /// What lies outside does not count, world metres.
    pub region: Option<Aabb>,
    /// Places that score less do not count.
    pub min_score: Option<f32>,
    /// Matches at most; 0: the usual number.
    pub top_k: usize,
    /// Whether every place that counts is wanted too, with its score.
    pub places: bool,
    /// As in [`super::PointsQuestion`].
    pub min_epoch: u64,
    pub max_age: Option<Duration>,
}

/// The answer: all of it from one epoch.
#[derive(Debug, Clone, PartialEq)]
pub struct FindReply {
    pub findings: Findings,
    pub encoder_id: String,
    pub epoch: u64,
    pub newest_stamp_ns: i64,
    /// Time spent in the server.
    pub spent: Duration,
}

/// A question for the classes of places; the prompts are the classes.
#[derive(Debug, Clone, PartialEq)]
pub struct ClassifyQuestion {
    pub map_id: String,
    /// World metres.
    pub points: Vec<Vec3>,
    /// Negatives are for relevancies alone, of which there are none here.
    pub classes: Sought,
    /// As in [`super::PointsQuestion`].
    pub min_epoch: u64,
    pub max_age: Option<Duration>,
}

/// The answer: all of it from one epoch.
#[derive(Debug, Clone, PartialEq)]
pub struct ClassifyReply {
    /// The place of each point's class, -1 where nothing was seen with features.
    pub class: Vec<i32>,
    /// Its cosine; NaN where there is none.
    pub score: Vec<f32>,
    pub encoder_id: String,
    pub epoch: u64,
    pub newest_stamp_ns: i64,
    /// Time spent in the server.
    pub spent: Duration,
}

/// Which encoders there are.
#[derive(Debug, Clone, PartialEq)]
pub struct Encoders {
    /// What embeds words here.
    pub server: Option<Contract>,
    /// That of the map's features.
    pub map: Option<Contract>,
    pub epoch: u64,
    pub newest_stamp_ns: i64,
}

impl FindQuestion {
    /// The usual number of things in the default map, whatever its age.
    pub fn new(sought: Sought) -> Self {
        Self {
            map_id: DEFAULT_MAP.into(),
            sought,
            region: None,
            min_score: None,
            top_k: 0,
            places: false,
            min_epoch: 0,
            max_age: None,
        }
    }

    /// What a view is asked; refuses what no map could answer. What is sought is checked with its
    /// encoder.
    pub fn settings(&self) -> Result<FindSettings> {
        if let Some(region) = self.region {
            for (name, corner) in [("min", region.min), ("max", region.max)] {
                if !corner.is_finite() {
                    return Err(Error::invalid(format!("region.{name}"), "must be finite"));
                }
            }
            if region.min.cmpgt(region.max).any() {
                return Err(Error::invalid("region", "min must not lie above max"));
            }
        }
        let usual = if self.sought.is_relevancy() { LEAST_RELEVANCY } else { LEAST_COSINE };
        let min_score = self.min_score.unwrap_or(usual);
        if !(-1.0..=1.0).contains(&min_score) {
            let problem = format!("{min_score} must be within -1..=1");
            return Err(Error::invalid("min_score", problem));
        }
        if self.top_k > MAX_MATCHES {
            let problem = format!("{} must be within 0..={MAX_MATCHES}", self.top_k);
            return Err(Error::invalid("top_k", problem));
        }
        let top_k = if self.top_k == 0 { MATCHES } else { self.top_k };
        Ok(FindSettings { region: self.region, min_score, top_k, places: self.places })
    }
}

/// Refuses to answer with more places than a question may have points.
pub(super) fn check_places(places: usize, max_points: usize) -> Result<()> {
    if places <= max_points {
        return Ok(());
    }
    Err(Error::ResourceExhausted {
        what: format!("{places} places; ask within a region, or for a larger min_score"),
        limit: format!("{max_points} an answer (server.max_points)"),
    })
}

impl ClassifyQuestion {
    /// The classes of `points` of the default map, whatever its age.
    pub fn new(points: Vec<Vec3>, classes: Sought) -> Self {
        Self { map_id: DEFAULT_MAP.into(), points, classes, min_epoch: 0, max_age: None }
    }

    /// Refuses what no map could answer. Classes are checked with their encoder.
    pub(super) fn check(&self, max_points: usize) -> Result<()> {
        check_points(&self.points, max_points)?;
        let classes = match &self.classes {
            Sought::Words { prompts, .. } => prompts.len(),
            Sought::Embeddings { prompts, .. } => prompts.len(),
        };
        let scores = self.points.len().saturating_mul(classes);
        if scores > MAX_CLASS_SCORES {
            let problem = format!(
                "{} points of {classes} classes are {scores} scores; the limit is \
                 {MAX_CLASS_SCORES}",
                self.points.len()
            );
            return Err(Error::invalid("classes", problem));
        }
        Ok(())
    }
}

impl Service {
    /// Which encoders the server and a map have.
    pub fn encoders(&self, map_id: &str) -> Result<Encoders> {
        let view = self.map(map_id)?.published().view;
        Ok(Encoders {
            server: self.words.encoder.as_ref().map(|encoder| encoder.contract().clone()),
            map: view.contract().cloned(),
            epoch: view.epoch(),
            newest_stamp_ns: view.newest_stamp_ns(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_no_map_could_answer_is_refused_by_name() {
        let question = || FindQuestion::new(Sought::words(&["chair"]));
        let settings = question().settings().expect("usual");
        assert_eq!((settings.min_score, settings.top_k), (0.5, 10));
        let cosines = Sought::Words { prompts: vec!["chair".into()], negatives: Some(Vec::new()) };
        assert_eq!(FindQuestion::new(cosines).settings().expect("usual").min_score, 0.1);
        let region = |min, max| Some(Aabb { min, max });
        type Spoil = fn(&mut FindQuestion);
        let cases: [(&str, &str, Spoil); 4] = [
            ("min_score", "-1..=1", |q| q.min_score = Some(f32::NAN)),
            ("min_score", "1.5", |q| q.min_score = Some(1.5)),
            ("top_k", "0..=1000", |q| q.top_k = 1001),
            ("region.max", "finite", |q| {
                q.region = Some(Aabb { min: Vec3::ZERO, max: Vec3::NAN });
            }),
        ];
        for (field, words, spoil) in cases {
            let mut question = question();
            spoil(&mut question);
            let error = question.settings().expect_err(words);
            assert_eq!(error.field(), Some(field), "{error}");
            assert!(error.to_string().contains(words), "{error}");
        }
        let turned = FindQuestion { region: region(Vec3::ONE, Vec3::ZERO), ..question() };
        assert_eq!(turned.settings().expect_err("turned").field(), Some("region"));
        let points = vec![Vec3::ZERO; MAX_CLASS_SCORES / 4096 + 1];
        let many = Sought::Words { prompts: vec!["chair".into(); 4096], negatives: None };
        let error = ClassifyQuestion::new(points, many).check(1 << 20).expect_err("too many");
        assert_eq!(error.field(), Some("classes"), "{error}");
    }
}
