//! What was found, in JSON.

use glam::Vec3;
use serde::Serialize;
use utoipa::ToSchema;

use super::schemas;
use crate::geometry::Pose;
use crate::map::{Findings, Match};
use crate::service::FindReply;

#[derive(Debug, Serialize, ToSchema)]
pub(super) struct TextAnswer {
    /// Best first.
    matches: Vec<Found>,
    /// If they were asked for: every place (vertex of codes) that counts.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(schema_with = schemas::points, required = false)]
    places_m: Option<Vec<Vec3>>,
    /// The score of each place.
    #[serde(skip_serializing_if = "Option::is_none")]
    place_score: Option<Vec<f32>>,
    /// The encoder of the map.
    encoder_id: String,
    /// The epoch that answered.
    epoch: u64,
    /// The capture time of its newest frame, Unix ns.
    newest_stamp_ns: i64,
    /// Time spent in the server, microseconds.
    server_us: u64,
}

/// A thing: places that score well and hang together.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Found {
    /// Its place in this answer, from 0.
    id: u32,
    /// The mean of the better half of its places.
    score: f32,
    #[schema(schema_with = schemas::triple)]
    centroid_m: Vec3,
    obb: Obb,
    /// Sides of the box along the world's axes.
    #[schema(schema_with = schemas::triple)]
    extent_m: Vec3,
    /// Places (vertices of codes) that it has.
    voxels: u32,
    /// The camera that showed it best, of those that the map remembers; null if none did.
    #[schema(required = true)]
    best_view: Option<View>,
}

/// A box that stands upright and is turned about the vertical.
#[derive(Debug, Serialize, ToSchema)]
struct Obb {
    #[schema(schema_with = schemas::triple)]
    center_m: Vec3,
    /// World from box: x, y, z, w of a unit quaternion.
    #[schema(schema_with = schemas::rotation)]
    rotation: [f32; 4],
    #[schema(schema_with = schemas::triple)]
    half_size_m: Vec3,
}

/// p_world = rotation · p_camera + translation; camera axes are optical.
#[derive(Debug, Serialize, ToSchema)]
struct View {
    #[schema(schema_with = schemas::translation)]
    translation: [f64; 3],
    #[schema(schema_with = schemas::rotation)]
    rotation: [f64; 4],
}

impl TextAnswer {
    /// `places`: whether they were asked for.
    pub(super) fn new(reply: FindReply, places: bool) -> Self {
        let Findings { matches, places: found } = reply.findings;
        Self {
            matches: matches.iter().map(Found::from).collect(),
            places_m: places.then_some(found.points),
            place_score: places.then_some(found.scores),
            encoder_id: reply.encoder_id,
            epoch: reply.epoch,
            newest_stamp_ns: reply.newest_stamp_ns,
            server_us: reply.spent.as_micros() as u64,
        }
    }
}

impl From<&Match> for Found {
    fn from(found: &Match) -> Self {
        let view = |pose: &Pose| View {
            translation: pose.translation.to_array(),
            rotation: pose.rotation.to_array(),
        };
        Self {
            id: found.id,
            score: found.score,
            centroid_m: found.centroid,
            obb: Obb {
                center_m: found.obb.center,
                rotation: found.obb.rotation.to_array(),
                half_size_m: found.obb.half_size,
            },
            extent_m: found.extent,
            voxels: found.voxels,
            best_view: found.best_view.as_ref().map(view),
        }
    }
}
