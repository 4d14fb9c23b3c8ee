//! Questions about points, in JSON or raw, and their answers, in JSON or raw.

use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::{HeaderName, HeaderValue, header};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use glam::Vec3;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::body::{Most, Parts, Received, Share, receive};
use super::language::Text;
use super::limits::RAW_POINT_BYTES;
use super::media::Media;
use super::openapi::{self, PointRefusals};
use super::options::{Field, Options, Policy};
use super::parse::{parse, whole};
use super::refusal::Refusal;
use super::{Edge, JSON, MapId, schemas};
use crate::error::Error;
use crate::map::Fields;
use crate::service::{Call, PointsReply};
use crate::wire::{COLUMNS, EPOCH, NEWEST_STAMP_NS, POINTS, SERVER_US, columns_to_wire};

/// JSON of more bytes than this is read and written off the network threads.
const IN_PLACE_BYTES: usize = 64 << 10;
/// About what a point takes in a JSON answer, bytes.
const JSON_ANSWER_BYTES: usize = 112;

/// A question about points. What it leaves out may stand in the query string.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct PointsRequest {
    #[schema(schema_with = schemas::points)]
    points_m: Vec<Vec3>,
    #[schema(schema_with = schemas::frame_id)]
    frame_id: Option<String>,
    /// The columns to answer; none means all of them.
    fields: Option<Vec<Field>>,
    #[serde(default, deserialize_with = "whole")]
    #[schema(schema_with = schemas::min_epoch)]
    min_epoch: Option<u64>,
    #[serde(default, deserialize_with = "whole")]
    #[schema(schema_with = schemas::max_age)]
    max_age_ms: Option<u64>,
    /// What stands in the columns of numbers where a point is unknown.
    unknown_policy: Option<Policy>,
    #[schema(schema_with = schemas::unknown_distance)]
    unknown_distance_m: Option<f32>,
    /// What `text_score` is the score of; with it that column is answered too.
    text: Option<Text>,
}

/// Columns in the order of the points; one that was not asked for, or that the map does not have, is
/// absent.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct PointsAnswer {
    /// The epoch that answered.
    epoch: u64,
    /// The capture time of its newest frame, Unix ns.
    newest_stamp_ns: i64,
    /// Time spent in the server, microseconds.
    server_us: u64,
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
    #[schema(schema_with = schemas::states, required = false)]
    state: Option<Vec<u8>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(schema_with = schemas::colors, required = false)]
    color: Option<Vec<Vec3>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(schema_with = schemas::text_scores, required = false)]
    text_score: Option<Vec<f32>>,
}

/// Distance, gradient, occupancy, state, color and how well a text fits, at points
///
/// One answer comes from one epoch. It has the form that `accept` prefers: JSON, or the columns as
/// little-endian numbers back to back, with their names, types, widths and offsets in the header
/// `orenx-columns`. A question may be raw too: a body of `application/octet-stream` with x y z of
/// each point as little-endian f32, finite and whole, and the options in the query string, under the
/// names that they have in JSON (`?fields=distance,state&min_epoch=4`); a text as its words, with commas
/// between them (`?prompts=red+chair,lamp&negatives=`).
#[utoipa::path(post, path = "/v1/maps/{map}/query/points", tag = "query",
    params(openapi::MapPath),
    request_body = PointsRequest,
    responses((status = 200, description = "The answers.",
        content((PointsAnswer = "application/json"), (openapi::Raw = "application/octet-stream")),
        headers(
            ("orenx-columns" = String, description = "Raw only: where each column is, as a \
                structured list (RFC 9651) such as `state;type=u8;width=1;offset=0`."),
            ("orenx-points" = u64, description = "Raw only: points."),
            ("orenx-epoch" = u64, description = "Raw only: as in JSON."),
            ("orenx-newest-stamp-ns" = i64, description = "Raw only: as in JSON."),
            ("orenx-server-us" = u64, description = "Raw only: as in JSON."))),
        PointRefusals))]
pub(super) async fn query(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
    request: Request,
) -> Result<Response, Refusal> {
    let service = edge.service()?;
    // Before the body comes: there may be much of it.
    service.map_detail(&map_id)?;
    let media = Media::of_body(request.headers())?;
    let wanted = Media::of_answer(request.headers(), media)?;
    let asked = Options::of_query(request.uri().query())?;
    let (points, options, share) = match media {
        Media::Json => read_json(&edge, request.into_body()).await?,
        Media::Raw => {
            let (points, share) = read_raw(&edge, request.into_body()).await?;
            (points, Options::default(), share)
        }
    };
    let question = options.or(asked).question(map_id, points);
    let (fields, points) = (question.fields, question.points.len());
    let reply = service.query_points(question, Call::HttpQueryPoints).await?;
    match wanted {
        Media::Json => {
            let bytes = points * JSON_ANSWER_BYTES;
            let body = off_thread(bytes, move || write_json(reply, fields, points)).await?;
            let body = Body::new(Parts::new(vec![Bytes::from(body)], share));
            Ok(([(header::CONTENT_TYPE, JSON)], body).into_response())
        }
        Media::Raw => Ok(write_raw(reply, fields, points, share)),
    }
}

async fn read_json(edge: &Edge, body: Body) -> Result<(Vec<Vec3>, Options, Share), Refusal> {
    let limits = &edge.limits;
    let most = Most::points(limits.json_bytes, limits.max_points);
    let received = receive::<u8>(body, most, limits, &edge.memory).await?;
    let Received { values, bytes, share } = received;
    let request: PointsRequest = off_thread(bytes, move || parse(&values)).await?;
    let options = Options {
        frame_id: request.frame_id,
        fields: request.fields,
        min_epoch: request.min_epoch,
        max_age_ms: request.max_age_ms,
        unknown_policy: request.unknown_policy,
        unknown_distance_m: request.unknown_distance_m,
        text: request.text.map(Text::sought).transpose()?,
    };
    options.check()?;
    Ok((request.points_m, options, share))
}

async fn read_raw(edge: &Edge, body: Body) -> Result<(Vec<Vec3>, Share), Refusal> {
    let limits = &edge.limits;
    let most = Most::points(limits.raw_bytes, limits.max_points);
    let received = receive::<Vec3>(body, most, limits, &edge.memory).await?;
    let Received { values, bytes, share } = received;
    if !bytes.is_multiple_of(RAW_POINT_BYTES) {
        let problem =
            format!("{bytes} bytes are no whole points of three f32, {RAW_POINT_BYTES} bytes each");
        return Err(Error::invalid("body", problem).into());
    }
    Ok((values, share))
}

/// A column that was asked for and that the map has.
pub(super) fn column<T>(is_asked: bool, values: Vec<T>, points: usize) -> Option<Vec<T>> {
    (is_asked && values.len() == points).then_some(values)
}

fn write_json(reply: PointsReply, fields: Fields, points: usize) -> Result<Vec<u8>, Refusal> {
    let answers = reply.answers;
    let answer = PointsAnswer {
        epoch: reply.epoch,
        newest_stamp_ns: reply.newest_stamp_ns,
        server_us: reply.spent.as_micros() as u64,
        distance_m: column(fields.distance, answers.distance, points),
        gradient: column(fields.gradient, answers.gradient, points),
        occupancy: column(fields.occupancy, answers.occupancy, points),
        state: column(fields.state, answers.state, points),
        color: column(fields.color, answers.color, points),
        text_score: column(fields.text_score, answers.text_score, points),
    };
    serde_json::to_vec(&answer)
        .map_err(|e| Error::Internal(format!("an answer did not become JSON: {e}")).into())
}

fn write_raw(reply: PointsReply, fields: Fields, points: usize, share: Share) -> Response {
    let columns = columns_to_wire(reply.answers, fields, points);
    raw(columns, points, (reply.epoch, reply.newest_stamp_ns, reply.spent), share)
}

/// Columns of `points` rows as they are, of an epoch and its newest stamp, after so much time.
pub(super) fn raw(
    (columns, parts): (String, Vec<Bytes>),
    points: usize,
    (epoch, newest_stamp_ns, spent): (u64, i64, Duration),
    share: Share,
) -> Response {
    let mut response = Response::new(Body::new(Parts::new(parts, share)));
    let headers = response.headers_mut();
    let name = HeaderName::from_static;
    let raw = HeaderValue::from_static("application/octet-stream");
    headers.insert(header::CONTENT_TYPE, raw);
    if let Ok(columns) = HeaderValue::from_str(&columns) {
        headers.insert(name(COLUMNS), columns);
    }
    headers.insert(name(POINTS), HeaderValue::from(points));
    headers.insert(name(EPOCH), HeaderValue::from(epoch));
    headers.insert(name(NEWEST_STAMP_NS), HeaderValue::from(newest_stamp_ns));
    headers.insert(name(SERVER_US), HeaderValue::from(spent.as_micros() as u64));
    response
}

/// Does `work` here if it is small, and where it holds nobody up if it is not.
pub(super) async fn off_thread<T: Send + 'static>(
    bytes: usize,
    work: impl FnOnce() -> Result<T, Refusal> + Send + 'static,
) -> Result<T, Refusal> {
    if bytes <= IN_PLACE_BYTES {
        return work();
    }
    let failed = |_| Err(Error::Internal("this request made the server fail".into()).into());
    tokio::task::spawn_blocking(work).await.unwrap_or_else(failed)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(body: &[u8]) -> Result<PointsRequest, Refusal> {
        parse(body)
    }

    fn problem(body: &str) -> String {
        format!("{:?}", read(body.as_bytes()).expect_err(body))
    }

    #[test]
    fn json_says_which_part_of_it_is_wrong() {
        let cases = [
            (r#"{"points_m":[[0,0,0],[1,2,"3"]]}"#, "points_m[1].z: "),
            (r#"{"points_m":[[0,0]]}"#, "points_m[0]: "),
            (r#"{"points_m":[[0,0,0,0]]}"#, "points_m[0]"),
            (r#"{"points_m":[0,0,0]}"#, "points_m[0]: "),
            (r#"{"points_m":7}"#, "points_m: "),
            (r#"{"points_m":[],"fields":["distance","colour"]}"#, "fields[1]: "),
            (r#"{"points_m":[],"min_epoch":-1}"#, "min_epoch: "),
            (r#"{"points_m":[],"max_age_ms":1.5}"#, "max_age_ms: "),
            (r#"{"points_m":[],"unknown_policy":"hope"}"#, "unknown_policy: "),
            (r#"{"points_m":[],"unknown_distance_m":"far"}"#, "unknown_distance_m: "),
            (r#"{"points_m":[],"point":1}"#, "point: unknown field"),
            (r#"{"fields":[]}"#, "body: missing field `points_m`"),
            (r#"{"points_m":[[0,0,0]"#, "EOF"),
            (r#"{"points_m":[]} x"#, "body: trailing characters"),
            (r#"{"points_m":[[NaN,0,0]]}"#, "points_m[0]"),
            (r#"{"points_m":[],"points_m":[]}"#, "duplicate field"),
            ("[]", "body"),
            ("", "body: EOF"),
        ];
        for (body, expected) in cases {
            let problem = problem(body);
            assert!(problem.contains(expected), "{body}: {problem}");
        }
        let good = r#"{"points_m":[[1,2.5,-3e-1]],"fields":null,"unknown_policy":"free"}"#;
        assert_eq!(read(good.as_bytes()).expect(good).points_m, [Vec3::new(1.0, 2.5, -0.3)]);
        let whole = r#"{"points_m":[],"min_epoch":7.0,"max_age_ms":null}"#;
        let request = read(whole.as_bytes()).expect(whole);
        assert_eq!((request.min_epoch, request.max_age_ms), (Some(7), None));
    }
}
