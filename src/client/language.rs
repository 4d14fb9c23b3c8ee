//! Questions in words or embeddings over HTTP.

use std::time::Duration;

use glam::{DQuat, DVec3, Quat, Vec3};
use serde::Deserialize;
use serde_json::{Value, json};

use super::HttpClient;
use crate::error::{Error, Result};
use crate::geometry::Pose;
use crate::map::{Findings, Match, OrientedBox, Places};
use crate::service::{ClassifyQuestion, ClassifyReply, FindQuestion, FindReply, Sought};

#[derive(Deserialize)]
struct Answer {
    matches: Vec<Found>,
    #[serde(default)]
    places_m: Vec<Vec3>,
    #[serde(default)]
    place_score: Vec<f32>,
    encoder_id: String,
    epoch: u64,
    newest_stamp_ns: i64,
    server_us: u64,
}

#[derive(Deserialize)]
struct Found {
    id: u32,
    score: f32,
    centroid_m: Vec3,
    obb: Obb,
    extent_m: Vec3,
    voxels: u32,
    best_view: Option<View>,
}

#[derive(Deserialize)]
struct Obb {
    center_m: Vec3,
    rotation: [f32; 4],
    half_size_m: Vec3,
}

#[derive(Deserialize)]
struct View {
    translation: [f64; 3],
    rotation: [f64; 4],
}

#[derive(Deserialize)]
struct Classes {
    class: Vec<i32>,
    score: Vec<Option<f32>>,
    encoder_id: String,
    epoch: u64,
    newest_stamp_ns: i64,
    server_us: u64,
}

impl HttpClient {
    /// The things in a map that fit what is sought.
    pub async fn find(&self, question: &FindQuestion) -> Result<FindReply> {
        let (verb, body) = find_request(question);
        let path = format!("/v1/maps/{}/query/{verb}", question.map_id);
        let answer: Answer = read(&self.post_json(&path, body.to_string()).await?)?;
        Ok(FindReply {
            findings: Findings {
                matches: answer.matches.into_iter().map(Match::from).collect(),
                places: Places { points: answer.places_m, scores: answer.place_score },
            },
            encoder_id: answer.encoder_id,
            epoch: answer.epoch,
            newest_stamp_ns: answer.newest_stamp_ns,
            spent: Duration::from_micros(answer.server_us),
        })
    }

    /// The classes of points.
    pub async fn classify(&self, question: &ClassifyQuestion) -> Result<ClassifyReply> {
        let path = format!("/v1/maps/{}/classify", question.map_id);
        let body = classify_request(question).to_string();
        let answer: Classes = read(&self.post_json(&path, body).await?)?;
        Ok(ClassifyReply {
            class: answer.class,
            score: answer.score.into_iter().map(|score| score.unwrap_or(f32::NAN)).collect(),
            encoder_id: answer.encoder_id,
            epoch: answer.epoch,
            newest_stamp_ns: answer.newest_stamp_ns,
            spent: Duration::from_micros(answer.server_us),
        })
    }
}

fn read<'a, T: Deserialize<'a>>(answer: &'a [u8]) -> Result<T> {
    serde_json::from_slice(answer).map_err(|e| Error::corrupt("the server's answer", e.to_string()))
}

/// The verb and the JSON of a question for things.
fn find_request(question: &FindQuestion) -> (&'static str, Value) {
    let (verb, mut body) = match &question.sought {
        Sought::Words { prompts, negatives } => {
            ("text", json!({ "prompts": prompts, "negatives": negatives }))
        }
        Sought::Embeddings { encoder_id, prompts, negatives } => (
            "embedding",
            json!({ "encoder_id": encoder_id, "prompts": prompts, "negatives": negatives }),
        ),
    };
    let region = question.region.map(|region| json!({ "min": region.min, "max": region.max }));
    body["region"] = json!(region);
    body["min_score"] = json!(question.min_score);
    body["top_k"] = json!(question.top_k);
    body["places"] = json!(question.places);
    body["min_epoch"] = json!(question.min_epoch);
    body["max_age_ms"] = json!(max_age_ms(question.max_age));
    (verb, body)
}

fn classify_request(question: &ClassifyQuestion) -> Value {
    let mut body = match &question.classes {
        Sought::Words { prompts, .. } => json!({ "classes": prompts }),
        Sought::Embeddings { encoder_id, prompts, .. } => {
            json!({ "encoder_id": encoder_id, "class_embeddings": prompts })
        }
    };
    body["points_m"] = json!(question.points);
    body["min_epoch"] = json!(question.min_epoch);
    body["max_age_ms"] = json!(max_age_ms(question.max_age));
    body
}

/// At least 1: a limit of 0 would read as none.
fn max_age_ms(age: Option<Duration>) -> Option<u64> {
    age.map(|age| (age.as_millis() as u64).max(1))
}

impl From<Found> for Match {
    fn from(found: Found) -> Self {
        Self {
            id: found.id,
            score: found.score,
            centroid: found.centroid_m,
            obb: OrientedBox {
                center: found.obb.center_m,
                rotation: Quat::from_array(found.obb.rotation),
                half_size: found.obb.half_size_m,
            },
            extent: found.extent_m,
            voxels: found.voxels,
            best_view: found.best_view.map(|view| Pose {
                rotation: DQuat::from_array(view.rotation),
                translation: DVec3::from_array(view.translation),
            }),
        }
    }
}
