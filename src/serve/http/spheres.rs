//! Questions about spheres, in JSON or raw, and their answers, in JSON or raw.

use std::sync::Arc;

use axum::extract::{Request, State};
use axum::response::Response;
use glam::Vec3;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::body::{Most, Share, receive};
use super::media::Media;
use super::openapi::{self, PointRefusals};
use super::options::{Field, Options, Policy};
use super::parse::whole;
use super::planner::{read, written};
use super::points::{column, raw};
use super::refusal::Refusal;
use super::{Edge, MapId, schemas};
use crate::error::Error;
use crate::map::{Fields, Sphere};
use crate::service::{Call, SpheresQuestion, SpheresReply, spheres_of};
use crate::wire::named_columns_to_wire;

/// A sphere in a raw body: four f32.
const RAW_SPHERE_BYTES: usize = 16;

/// Spheres in the world. What it leaves out may stand in the query string.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct SpheresRequest {
    #[schema(schema_with = schemas::spheres)]
    spheres_m: Vec<[f32; 4]>,
    #[schema(schema_with = schemas::sphere_fields)]
    fields: Option<Vec<Field>>,
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

/// Columns in the order of the spheres.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct SpheresAnswer {
    epoch: u64,
    newest_stamp_ns: i64,
    server_us: u64,
    /// Distance of the center less the radius, m; null where unknown.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(schema_with = schemas::numbers_or_null, required = false)]
    clearance_m: Option<Vec<f32>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(schema_with = schemas::gradients, required = false)]
    gradient: Option<Vec<Vec3>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(schema_with = schemas::occupancies, required = false)]
    occupancy: Option<Vec<f32>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(schema_with = schemas::states, required = false)]
    state: Option<Vec<u8>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(schema_with = schemas::colors, required = false)]
    color: Option<Vec<Vec3>>,
}

/// How far spheres are from surfaces
///
/// As for points, in JSON or raw: a body of `application/octet-stream` holds x y z r of each sphere as
/// little-endian f32, with the options in the query string.
#[utoipa::path(post, path = "/v1/maps/{map}/query/spheres", tag = "planner",
    params(openapi::MapPath), request_body = SpheresRequest,
    responses((status = 200, description = "The answers.",
        content((SpheresAnswer = "application/json"), (openapi::Raw = "application/octet-stream"))),
        PointRefusals))]
pub(super) async fn spheres(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
    request: Request,
) -> Result<Response, Refusal> {
    let service = edge.service()?;
    service.map_detail(&map_id)?;
    let media = Media::of_body(request.headers())?;
    let wanted = Media::of_answer(request.headers(), media)?;
    let asked = Options::of_query(request.uri().query())?;
    let (spheres, options, share) = match media {
        Media::Json => read_json(&edge, request).await?,
        Media::Raw => {
            let limits = &edge.limits;
            let most = Most::points(limits.max_points * RAW_SPHERE_BYTES, limits.max_points);
            let received = receive::<f32>(request.into_body(), most, limits, &edge.memory).await?;
            if !received.bytes.is_multiple_of(RAW_SPHERE_BYTES) {
                let problem = format!("{} bytes are no whole spheres of four f32", received.bytes);
                return Err(Error::invalid("body", problem).into());
            }
            (spheres_of(&received.values)?, Options::default(), received.share)
        }
    };
    let options = options.or(asked);
    let usual = Fields { gradient: true, state: true, ..Fields::DISTANCE };
    let fields = options.fields_or(usual);
    let question = SpheresQuestion { terms: options.terms(map_id), spheres, fields };
    let count = question.spheres.len();
    let reply = service.query_spheres(question, Call::HttpQuerySpheres).await?;
    match wanted {
        Media::Raw => {
            let of = (reply.epoch, reply.newest_stamp_ns, reply.spent);
            let columns = named_columns_to_wire("clearance_m", reply.answer, fields, count);
            Ok(raw(columns, count, of, share))
        }
        Media::Json => written(count, share, move || answer(reply, fields, count)).await,
    }
}

async fn read_json(
    edge: &Edge,
    request: Request,
) -> Result<(Vec<Sphere>, Options, Share), Refusal> {
    let (request, share): (SpheresRequest, Share) = read(edge, request).await?;
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
    Ok((bytemuck::cast_vec(request.spheres_m), options, share))
}

fn answer(reply: SpheresReply, fields: Fields, count: usize) -> SpheresAnswer {
    let answers = reply.answer;
    SpheresAnswer {
        epoch: reply.epoch,
        newest_stamp_ns: reply.newest_stamp_ns,
        server_us: reply.spent.as_micros() as u64,
        clearance_m: column(fields.distance, answers.distance, count),
        gradient: column(fields.gradient, answers.gradient, count),
        occupancy: column(fields.occupancy, answers.occupancy, count),
        state: column(fields.state, answers.state, count),
        color: column(fields.color, answers.color, count),
    }
}
