//! Images over HTTP: one a request.

use std::time::Duration;

use glam::Vec3;
use serde::Deserialize;
use serde_json::{Value, json};

use super::HttpClient;
use crate::config::name_of;
use crate::error::{Error, Result};
use crate::geometry::Aabb;
use crate::map::{Camera, Encoding};
use crate::service::{ImageKind, ImageQuestion, ImageReply, Sought};
use crate::wire::{EPOCH, HEIGHT, NEWEST_STAMP_NS, SERVER_US, WIDTH};

#[derive(Deserialize)]
struct MapDetail {
    map: Map,
}

#[derive(Deserialize)]
struct Map {
    bounds: Option<Bounds>,
}

#[derive(Deserialize)]
struct Bounds {
    min: Vec3,
    max: Vec3,
}

impl HttpClient {
    /// The images that a question asks for. Each may be of a later epoch than the one before it; the
    /// reply has the last one's.
    pub async fn render(&self, question: &ImageQuestion) -> Result<ImageReply> {
        let path = format!("/v1/maps/{}/render", question.map_id);
        let mut reply = ImageReply {
            images: Vec::with_capacity(question.images.len()),
            width: question.camera.intrinsics.width,
            height: question.camera.intrinsics.height,
            epoch: question.min_epoch,
            newest_stamp_ns: 0,
            spent: Duration::ZERO,
        };
        for kind in &question.images {
            let body = image_request(question, *kind, reply.epoch).to_string();
            let answer = self.posted_json(&path, body).await?;
            reply.width = answer.number(WIDTH)?;
            reply.height = answer.number(HEIGHT)?;
            reply.epoch = answer.number(EPOCH)?;
            reply.newest_stamp_ns = answer.number(NEWEST_STAMP_NS)?;
            reply.spent += Duration::from_micros(answer.number(SERVER_US)?);
            reply.images.push((*kind, answer.body.to_vec()));
        }
        Ok(reply)
    }

    /// The box around everything that a map has observed; empty for an empty map.
    pub async fn bounds(&self, map_id: &str) -> Result<Aabb> {
        let answer = self.get(&format!("/v1/maps/{map_id}")).await?;
        let detail: MapDetail = serde_json::from_slice(&answer)
            .map_err(|e| Error::corrupt("the server's answer", e.to_string()))?;
        Ok(match detail.map.bounds {
            Some(Bounds { min, max }) => Aabb { min, max },
            None => Aabb::EMPTY,
        })
    }
}

/// The JSON of a question for one image.
fn image_request(question: &ImageQuestion, kind: ImageKind, min_epoch: u64) -> Value {
    let mut request = camera_json(&question.camera);
    request["output"] = json!(kind.output.name());
    request["encoding"] = json!(kind.encoding.name());
    request["renderer"] = json!(name_of(question.renderer));
    request["min_epoch"] = json!(min_epoch);
    request["text"] = json!(question.text.as_ref().map(text_json));
    if let Encoding::Jpeg { quality } = kind.encoding {
        request["jpeg_quality"] = json!(quality);
    }
    if let Some(age) = question.max_age {
        // At least 1: a limit of 0 would read as none.
        request["max_age_ms"] = json!((age.as_millis() as u64).max(1));
    }
    request
}

/// What a heat is the heat of.
fn text_json(sought: &Sought) -> Value {
    match sought {
        Sought::Words { prompts, negatives } => {
            json!({ "prompts": prompts, "negatives": negatives })
        }
        Sought::Embeddings { encoder_id, prompts, negatives } => json!({
            "encoder_id": encoder_id, "prompt_embeddings": prompts,
            "negative_embeddings": negatives,
        }),
    }
}

/// What a question for an image cannot do without.
pub fn camera_json(camera: &Camera) -> Value {
    let (pose, k) = (&camera.world_from_camera, &camera.intrinsics);
    json!({
        "world_from_camera": {
            "translation": pose.translation.to_array(), "rotation": pose.rotation.to_array(),
        },
        "intrinsics": {
            "fx": k.fx, "fy": k.fy, "cx": k.cx, "cy": k.cy, "width": k.width, "height": k.height,
        },
    })
}
