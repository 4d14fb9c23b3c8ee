//! Changes of a map by hand: what was seen is forgotten, known geometry is put in.

use std::sync::Arc;
use std::time::Instant;

use axum::extract::{Request, State};
use axum::response::Response;
use glam::{DQuat, DVec3, Vec3};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::media::Media;
use super::openapi::{self, EditRefusals};
use super::planner::read;
use super::refusal::Refusal;
use super::{Edge, MapId, json, schemas};
use crate::error::{self, Error};
use crate::geometry::{Aabb, Mesh, Pose, Region, Solid};
use crate::map::{Clear, Edit, Edited, STAMP_ROBOT, Stamp};
use crate::surface::Stamping;

/// What is to be forgotten: what all of the conditions that are there say. At least one must be, and of
/// box and sphere one at most.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct ClearRequest {
    r#box: Option<ClearBox>,
    sphere: Option<Ball>,
    /// What only this robot saw. Where others saw it too it stays. Alone, it also takes the robot's key
    /// frames out of the training. 404 if the map knows no such robot.
    #[schema(min_length = 1, max_length = 256)]
    robot_id: Option<String>,
    /// What was last seen before this capture time, Unix ns. In doubt it stays.
    older_than_ns: Option<i64>,
}

/// World metres.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct ClearBox {
    #[schema(schema_with = schemas::corner)]
    min: Vec3,
    #[schema(schema_with = schemas::corner)]
    max: Vec3,
}

/// World metres.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct Ball {
    #[schema(schema_with = schemas::corner)]
    center: Vec3,
    #[schema(exclusive_minimum = 0.0, maximum = 10_000.0)]
    radius_m: f32,
}

/// Known geometry: one of box, sphere and mesh.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct StampRequest {
    r#box: Option<SolidBox>,
    sphere: Option<Ball>,
    mesh: Option<Triangles>,
    /// `add` by default.
    mode: Option<Mode>,
    /// Under whose name it is in the map, to be cleared by; "stamp" by default.
    #[schema(min_length = 1, max_length = 256)]
    robot_id: Option<String>,
    /// \[r, g, b\] of the surface, sRGB within 0..1; none if left out.
    color: Option<[f32; 3]>,
}

/// `add`: the surface is there, and what is inside is occupied; `free`: all whole cells of 0.1 m inside
/// are known and free.
#[derive(Debug, Clone, Copy, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
enum Mode {
    Add,
    Free,
}

#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct SolidBox {
    world_from_box: BoxPose,
    /// Edge lengths, m, above 0.
    #[schema(schema_with = schemas::corner)]
    size_m: Vec3,
}

/// The box's middle and axes.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct BoxPose {
    #[schema(schema_with = schemas::place)]
    translation: [f64; 3],
    #[schema(schema_with = schemas::rotation)]
    rotation: [f64; 4],
}

/// Counterclockwise seen from outside; one that is closed is turned if it is inside out. One that is open
/// has a surface and no inside, and cannot be free.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct Triangles {
    /// \[x, y, z\] of each vertex, world metres.
    #[schema(min_items = 1, max_items = 65536)]
    vertices_m: Vec<[f32; 3]>,
    /// The numbers of the vertices of each triangle, from 0.
    #[schema(min_items = 1, max_items = 65536)]
    triangles: Vec<[u32; 3]>,
}

/// What a change by hand did.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct EditAnswer {
    /// The first epoch that holds it.
    epoch: u64,
    surfels_removed: u64,
    /// New surfels, and those that took another's place.
    surfels_added: u64,
    /// Cells of evidence, 0.1 m each, that are unknown again, and those that were told occupied or free.
    cells_forgotten: u64,
    cells_told: u64,
    /// Views of a robot that training had kept.
    key_frames_dropped: u64,
    /// Time spent in the server, microseconds.
    server_us: u64,
}

/// Forgets what was seen
///
/// In a box or a ball, by one robot alone, before a stamp, or where all of the conditions that are given
/// hold. It comes after the frames that wait when it is asked for, and is published when it is answered;
/// questions are answered from the old map meanwhile. Surfels are forgotten within the region, evidence of
/// space in all cells of 0.1 m that it touches; close to a surface that is left (up to 0.2 m), distances are
/// known as around any surface.
#[utoipa::path(post, path = "/v1/maps/{map}/clear", tag = "maps",
    params(openapi::MapPath), request_body = ClearRequest,
    responses((status = 200, description = "It is forgotten.", body = EditAnswer), EditRefusals))]
pub(super) async fn clear(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
    request: Request,
) -> Result<Response, Refusal> {
    let started = Instant::now();
    let service = edge.service()?;
    service.map_detail(&map_id)?;
    Media::json_body(request.headers())?;
    let (request, _share) = read::<ClearRequest>(&edge, request).await?;
    let edited = service.edit_map(&map_id, Edit::Clear(request.read()?)).await?;
    json(&EditAnswer::new(edited, started))
}

/// Puts known geometry into the map
///
/// In the same order with frames as `clear`. It is answered like mapped surfaces, is saved with them, and
/// is cleared by its `robot_id`. Frames overrule it as they overrule any surface. Its surface may pass
/// 1 048 576 surfels (4 cm each in `lite`: 1678 m²), the box around it 2 097 152 cells of evidence (0.1 m
/// each: 2097 m³).
#[utoipa::path(post, path = "/v1/maps/{map}/stamp", tag = "maps",
    params(openapi::MapPath), request_body = StampRequest,
    responses((status = 200, description = "It is there.", body = EditAnswer), EditRefusals))]
pub(super) async fn stamp(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
    request: Request,
) -> Result<Response, Refusal> {
    let started = Instant::now();
    let service = edge.service()?;
    service.map_detail(&map_id)?;
    Media::json_body(request.headers())?;
    let (request, _share) = read::<StampRequest>(&edge, request).await?;
    // Off the network threads: a mesh may be large.
    let stamp = tokio::task::spawn_blocking(move || request.read())
        .await
        .map_err(|_| Error::Internal("reading an edit failed".into()))??;
    let edited = service.edit_map(&map_id, Edit::Stamp(stamp)).await?;
    json(&EditAnswer::new(edited, started))
}

impl ClearRequest {
    fn read(self) -> error::Result<Clear> {
        let region = match (self.r#box, self.sphere) {
            (Some(_), Some(_)) => {
                return Err(Error::invalid("sphere", "a box and a sphere are one too many"));
            }
            (Some(ClearBox { min, max }), None) => Some(Region::Box(Aabb { min, max })),
            (None, Some(Ball { center, radius_m })) => Some(Region::Sphere { center, radius_m }),
            (None, None) => None,
        };
        Ok(Clear { region, robot_id: self.robot_id, older_than_ns: self.older_than_ns })
    }
}

impl StampRequest {
    fn read(self) -> error::Result<Stamp> {
        let solid = match (self.r#box, self.sphere, self.mesh) {
            (Some(solid), None, None) => {
                let BoxPose { translation, rotation } = solid.world_from_box;
                let world_from_box = Pose {
                    rotation: DQuat::from_array(rotation),
                    translation: DVec3::from_array(translation),
                };
                Solid::Box { world_from_box, size_m: solid.size_m }
            }
            (None, Some(Ball { center, radius_m }), None) => Solid::Sphere { center, radius_m },
            (None, None, Some(mesh)) => {
                let vertices = mesh.vertices_m.into_iter().map(Vec3::from).collect();
                Solid::Mesh(Mesh::new(vertices, mesh.triangles)?)
            }
            _ => {
                return Err(Error::invalid("geometry", "one of box, sphere and mesh is required"));
            }
        };
        Ok(Stamp {
            solid,
            stamping: match self.mode {
                Some(Mode::Free) => Stamping::Free,
                Some(Mode::Add) | None => Stamping::Add,
            },
            color: self.color.map(Vec3::from),
            robot_id: self.robot_id.unwrap_or_else(|| STAMP_ROBOT.into()),
        })
    }
}

impl EditAnswer {
    fn new(edited: Edited, started: Instant) -> Self {
        Self {
            epoch: edited.epoch,
            surfels_removed: edited.surfels_removed,
            surfels_added: edited.surfels_added,
            cells_forgotten: edited.cells_forgotten,
            cells_told: edited.cells_told,
            key_frames_dropped: edited.key_frames_dropped,
            server_us: started.elapsed().as_micros() as u64,
        }
    }
}
