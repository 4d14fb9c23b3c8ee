//! Boxes of voxels, in JSON or raw.

use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::{HeaderName, HeaderValue};
use axum::response::Response;
use glam::{UVec3, Vec3};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::media::Media;
use super::openapi::{self, PointRefusals};
use super::options::{Field, Options, Policy};
use super::parse::whole;
use super::planner::{read, written};
use super::points::raw;
use super::refusal::Refusal;
use super::{Edge, MapId, schemas};
use crate::error::Error;
use crate::geometry::Aabb;
use crate::map::{Fields, GridShape};
use crate::service::{Answered, Call, Grid, GridColumns, GridQuestion, NumberFormat};
use crate::wire::Columns;

/// The headers with the voxels of a raw grid: low corner of the low voxel, edge, voxels along x y z.
const ORIGIN_M: HeaderName = HeaderName::from_static("orenx-origin-m");
const VOXEL_M: HeaderName = HeaderName::from_static("orenx-voxel-m");
const SIZE: HeaderName = HeaderName::from_static("orenx-size");
/// Voxels of a grid in JSON at most.
const JSON_VOXELS: u64 = 1 << 20;

/// A box of voxels.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct GridRequest {
    region: Region,
    #[schema(schema_with = schemas::voxel)]
    voxel_m: f32,
    /// The columns to answer; none means distance and state.
    fields: Option<Vec<Field>>,
    /// Of the numbers in a raw answer; `f32` by default.
    format: Option<Format>,
    #[schema(schema_with = schemas::frame_id)]
    frame_id: Option<String>,
    #[serde(default, deserialize_with = "whole")]
    #[schema(schema_with = schemas::min_epoch)]
    min_epoch: Option<u64>,
    #[serde(default, deserialize_with = "whole")]
    #[schema(schema_with = schemas::max_age)]
    max_age_ms: Option<u64>,
    unknown_policy: Option<Policy>,
    #[schema(schema_with = schemas::unknown_distance)]
    unknown_distance_m: Option<f32>,
}

/// Its low corner is that of the first voxel; as many voxels as cover it.
#[derive(Debug, Clone, Copy, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(as = GridRegion)]
pub(super) struct Region {
    #[schema(schema_with = schemas::corner)]
    min: Vec3,
    #[schema(schema_with = schemas::corner)]
    max: Vec3,
}

impl From<Region> for Aabb {
    fn from(Region { min, max }: Region) -> Self {
        Self { min, max }
    }
}

/// Little-endian floats of four or two bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
enum Format {
    F32,
    F16,
}

/// Voxel i j k is at place i · stride\[0\] + j · stride\[1\] + k · stride\[2\] of each column, its
/// center at origin_m + (i + 0.5, j + 0.5, k + 0.5) · voxel_m.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct GridAnswer {
    epoch: u64,
    newest_stamp_ns: i64,
    server_us: u64,
    #[schema(schema_with = schemas::triple)]
    origin_m: Vec3,
    voxel_m: f32,
    size: [u32; 3],
    stride: [u32; 3],
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(schema_with = schemas::distances, required = false)]
    distance_m: Option<Vec<f32>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(schema_with = schemas::gradients, required = false)]
    gradient: Option<Vec<Vec3>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(schema_with = schemas::occupancies, required = false)]
    occupancy: Option<Vec<f32>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(schema_with = schemas::colors, required = false)]
    color: Option<Vec<Vec3>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(schema_with = schemas::states, required = false)]
    state: Option<Vec<u8>>,
}

/// Any fields in the voxels of a box
///
/// At most 8 388 608 voxels and 56 MiB, in JSON 1 048 576 voxels; as raw columns with `accept:
/// application/octet-stream`, with the voxels in the headers `orenx-origin-m`, `orenx-voxel-m` and
/// `orenx-size`.
#[utoipa::path(post, path = "/v1/maps/{map}/grid", tag = "planner",
    params(openapi::MapPath), request_body = GridRequest,
    responses((status = 200, description = "The voxels.",
        content((GridAnswer = "application/json"), (openapi::Raw = "application/octet-stream"))),
        PointRefusals))]
pub(super) async fn grid(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
    request: Request,
) -> Result<Response, Refusal> {
    let service = edge.service()?;
    service.map_detail(&map_id)?;
    Media::json_body(request.headers())?;
    let wanted = Media::of_answer(request.headers(), Media::Json)?;
    let (request, mut share) = read::<GridRequest>(&edge, request).await?;
    let options = Options {
        frame_id: request.frame_id,
        fields: request.fields,
        min_epoch: request.min_epoch,
        max_age_ms: request.max_age_ms,
        unknown_policy: request.unknown_policy,
        unknown_distance_m: request.unknown_distance_m,
        text: None,
    };
    options.check()?;
    let is_raw = wanted == Media::Raw;
    let format = match request.format {
        Some(Format::F16) if is_raw => NumberFormat::F16,
        _ => NumberFormat::F32,
    };
    let question = GridQuestion {
        terms: options.terms(map_id),
        region: request.region.into(),
        voxel_m: request.voxel_m,
        fields: options.fields_or(Fields { state: true, ..Fields::DISTANCE }),
        format,
    };
    let voxels = question.voxels()?;
    if !is_raw && voxels > JSON_VOXELS {
        let problem = format!("{voxels} voxels; the limit in JSON is {JSON_VOXELS}");
        return Err(Error::invalid("region", problem).into());
    }
    // The most that it can take, before it is worked out for nothing.
    share.grow(share.bytes().max(question.bytes()? as usize))?;
    let reply = service.get_grid(question, Call::HttpGetGrid).await?;
    let Answered { answer: Grid { shape, columns, .. }, epoch, newest_stamp_ns, spent } = reply;
    if is_raw {
        let columns = raw_columns(columns, voxels as usize, format);
        let response = raw(columns, voxels as usize, (epoch, newest_stamp_ns, spent), share);
        return Ok(with_shape(response, &shape));
    }
    written(voxels as usize, share, move || GridAnswer {
        epoch,
        newest_stamp_ns,
        server_us: spent.as_micros() as u64,
        origin_m: shape.origin,
        voxel_m: shape.voxel_m,
        size: shape.size.to_array(),
        stride: shape.stride().to_array(),
        distance_m: numbers(columns.distance),
        gradient: vectors(columns.gradient),
        occupancy: numbers(columns.occupancy),
        color: vectors(columns.color),
        state: (!columns.state.is_empty()).then_some(columns.state),
    })
    .await
}

/// An answer whose headers say where its voxels are.
fn with_shape(mut response: Response, shape: &GridShape) -> Response {
    let Vec3 { x, y, z } = shape.origin;
    let UVec3 { x: i, y: j, z: k } = shape.size;
    for (name, text) in [
        (ORIGIN_M, format!("{x}, {y}, {z}")),
        (VOXEL_M, shape.voxel_m.to_string()),
        (SIZE, format!("{i}, {j}, {k}")),
    ] {
        if let Ok(value) = HeaderValue::from_str(&text) {
            response.headers_mut().insert(name, value);
        }
    }
    response
}

fn raw_columns(
    columns: GridColumns,
    voxels: usize,
    format: NumberFormat,
) -> (String, Vec<bytes::Bytes>) {
    let kind = if format == NumberFormat::F16 { "f16" } else { "f32" };
    let mut out = Columns::new(voxels);
    out.push_bytes("distance_m", kind, 1, columns.distance);
    out.push_bytes("gradient", kind, 3, columns.gradient);
    out.push_bytes("occupancy", kind, 1, columns.occupancy);
    out.push_bytes("color", kind, 3, columns.color);
    out.push_bytes("state", "u8", 1, columns.state);
    out.finish()
}

/// A column as numbers; none where it has none.
fn numbers(bytes: Vec<u8>) -> Option<Vec<f32>> {
    (!bytes.is_empty()).then(|| bytemuck::pod_collect_to_vec(&bytes))
}

fn vectors(bytes: Vec<u8>) -> Option<Vec<Vec3>> {
    (!bytes.is_empty()).then(|| bytemuck::pod_collect_to_vec(&bytes))
}
