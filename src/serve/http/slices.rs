//! Horizontal slices: as a picture, in JSON, raw.

use std::io::Cursor;
use std::sync::Arc;

use axum::body::Body;
use axum::extract::{RawQuery, State};
use axum::http::{HeaderName, HeaderValue, header};
use axum::response::Response;
use bytes::Bytes;
use glam::Vec3;
use image::{DynamicImage, GrayImage, ImageFormat, Luma};
use serde::Serialize;
use utoipa::ToSchema;

use super::openapi::{self, PointRefusals};
use super::options::{Options, POLICIES, Policy, decoded, number, one_of};
use super::points::{off_thread, raw};
use super::refusal::Refusal;
use super::{Edge, MapId, json as json_response, schemas};
use crate::error::Error;
use crate::geometry::Aabb;
use crate::map::{Costs, draw_slice};
use crate::service::{Answered, Call, Level, SliceQuestion, SliceReply};
use crate::wire::{Columns, EPOCH, HEIGHT, NEWEST_STAMP_NS, SERVER_US, WIDTH};

/// The headers with the place of a raw slice.
const ORIGIN_M: HeaderName = HeaderName::from_static("orenx-origin-m");
const RESOLUTION_M: HeaderName = HeaderName::from_static("orenx-resolution-m");
/// Drawing takes long enough to hold others up.
const DRAWN_BYTES: usize = 1 << 20;

/// What a slice shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ToSchema)]
#[schema(rename_all = "lowercase")]
enum Shown {
    Distance,
    Cost,
}

/// What a slice is made of; a key that does not exist, or twice, is refused.
#[derive(utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[expect(dead_code, reason = "stands for the query string in the document")]
pub(super) struct SliceQuery {
    /// Height of the plane, or of a band's lower end, m.
    #[param(minimum = -10_000.0, maximum = 10_000.0, example = 0.5)]
    z: f32,
    /// The upper end of a band: a cell has the least distance of its heights.
    #[param(minimum = -10_000.0, maximum = 10_000.0)]
    z_max: Option<f32>,
    /// Edge of a cell, m.
    #[param(minimum = 0.001, maximum = 100.0, example = 0.05)]
    res: f32,
    /// x0,y0,x1,y1 in metres; left out: all that was observed.
    #[param(example = "-1,-1,1,1")]
    region: Option<String>,
    /// `distance` by default; `cost` as Nav2 reads occupancy grids, which needs `inflation`.
    #[param(inline)]
    field: Option<Shown>,
    /// Up to here from an obstacle a cell costs 100, m; 0 by default.
    #[param(minimum = 0.0, maximum = 100.0)]
    robot_radius: Option<f32>,
    /// From 99 beyond the radius costs fall to 0 here, m.
    #[param(minimum = 0.0, maximum = 100.0)]
    inflation: Option<f32>,
    #[param(maximum = 9_007_199_254_740_991_u64)]
    min_epoch: Option<u64>,
    #[param(maximum = 9_007_199_254_740_991_u64)]
    max_age_ms: Option<u64>,
    #[param(inline)]
    unknown_policy: Option<Policy>,
    #[param(minimum = 1e-30, maximum = 10_000.0)]
    unknown_distance_m: Option<f32>,
}

/// Cell i j is at place i + j · width, its center at origin_m + (i + 0.5, j + 0.5) · resolution_m.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct SliceAnswer {
    epoch: u64,
    newest_stamp_ns: i64,
    server_us: u64,
    /// Low corner of the low cell, and the height of the plane or of the band's lower end.
    #[schema(schema_with = schemas::triple)]
    origin_m: Vec3,
    resolution_m: f32,
    width: u32,
    height: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(schema_with = schemas::distances, required = false)]
    distance_m: Option<Vec<f32>>,
    /// 0 to 100; -1 where unknown.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(required = false)]
    cost: Option<Vec<i8>>,
}

/// A slice as a picture
///
/// Distances in colour with axes and a scale; costs as map files of ROS have them: 254 free, 0 occupied,
/// 205 unknown, a pixel a cell, x to the right and y up.
#[utoipa::path(get, path = "/v1/maps/{map}/slice.png", tag = "planner",
    params(openapi::MapPath, SliceQuery),
    responses((status = 200, description = "The picture.", content((openapi::Raw = "image/png"))),
        PointRefusals))]
pub(super) async fn png(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
    RawQuery(query): RawQuery,
) -> Result<Response, Refusal> {
    let reply = answer(&edge, map_id, query).await?;
    let Answered { answer, epoch, newest_stamp_ns, spent } = reply;
    let (width, height) = (answer.shape.width, answer.shape.height);
    let image = off_thread(DRAWN_BYTES, move || picture(&answer)).await?;
    let mut response = Response::new(Body::from(image));
    let headers = response.headers_mut();
    let name = HeaderName::from_static;
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("image/png"));
    headers.insert(name(WIDTH), HeaderValue::from(width));
    headers.insert(name(HEIGHT), HeaderValue::from(height));
    headers.insert(name(EPOCH), HeaderValue::from(epoch));
    headers.insert(name(NEWEST_STAMP_NS), HeaderValue::from(newest_stamp_ns));
    headers.insert(name(SERVER_US), HeaderValue::from(spent.as_micros() as u64));
    Ok(response)
}

/// A slice in JSON
#[utoipa::path(get, path = "/v1/maps/{map}/slice.json", tag = "planner",
    params(openapi::MapPath, SliceQuery),
    responses((status = 200, description = "The cells.", body = SliceAnswer), PointRefusals))]
pub(super) async fn json(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
    RawQuery(query): RawQuery,
) -> Result<Response, Refusal> {
    let reply = answer(&edge, map_id, query).await?;
    let Level { shape, distance_m, cost } = reply.answer;
    json_response(&SliceAnswer {
        epoch: reply.epoch,
        newest_stamp_ns: reply.newest_stamp_ns,
        server_us: reply.spent.as_micros() as u64,
        origin_m: shape.origin.extend(shape.heights.first().copied().unwrap_or_default()),
        resolution_m: shape.resolution_m,
        width: shape.width,
        height: shape.height,
        distance_m: (!distance_m.is_empty()).then_some(distance_m),
        cost: (!cost.is_empty()).then_some(cost),
    })
}

/// A slice as raw numbers
///
/// A column `distance_m` of little-endian f32, or `cost` of signed bytes, with the cells in the headers
/// `orenx-origin-m`, `orenx-resolution-m`, `orenx-width` and `orenx-height`.
#[utoipa::path(get, path = "/v1/maps/{map}/slice.bin", tag = "planner",
    params(openapi::MapPath, SliceQuery),
    responses((status = 200, description = "The cells.",
        content((openapi::Raw = "application/octet-stream"))), PointRefusals))]
pub(super) async fn bin(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
    RawQuery(query): RawQuery,
) -> Result<Response, Refusal> {
    let reply = answer(&edge, map_id, query).await?;
    let Answered { answer: Level { shape, distance_m, cost }, epoch, newest_stamp_ns, spent } =
        reply;
    let cells = shape.cells();
    let mut columns = Columns::new(cells);
    columns.push("distance_m", true, 1, distance_m);
    columns.push_bytes("cost", "i8", 1, bytemuck::cast_vec(cost));
    let share = edge.share(cells * size_of::<f32>())?;
    let mut response = raw(columns.finish(), cells, (epoch, newest_stamp_ns, spent), share);
    let headers = response.headers_mut();
    let origin = shape.origin.extend(shape.heights.first().copied().unwrap_or_default());
    for (name, text) in [
        (ORIGIN_M, format!("{}, {}, {}", origin.x, origin.y, origin.z)),
        (RESOLUTION_M, shape.resolution_m.to_string()),
        (HeaderName::from_static(WIDTH), shape.width.to_string()),
        (HeaderName::from_static(HEIGHT), shape.height.to_string()),
    ] {
        if let Ok(value) = HeaderValue::from_str(&text) {
            headers.insert(name, value);
        }
    }
    Ok(response)
}

async fn answer(edge: &Edge, map_id: String, query: Option<String>) -> Result<SliceReply, Refusal> {
    let service = edge.service()?;
    service.map_detail(&map_id)?;
    let question = question(map_id, query.as_deref())?;
    Ok(service.get_slice(question, Call::HttpGetSlice).await?)
}

/// Reads a query string.
fn question(map_id: String, query: Option<&str>) -> Result<SliceQuestion, Refusal> {
    const SHOWN: [(&str, Shown); 2] = [("distance", Shown::Distance), ("cost", Shown::Cost)];
    let mut options = Options::default();
    let (mut z, mut z_max, mut resolution, mut region) = (None, None, None, None);
    let (mut shown, mut radius, mut inflation) = (None, None, None);
    for pair in query.unwrap_or_default().split('&').filter(|pair| !pair.is_empty()) {
        let (key, value) = pair.split_once('=').unwrap_or((pair, ""));
        let (key, value) = (decoded(key)?, decoded(value)?);
        let is_first = match key.as_str() {
            "z" => z.replace(number(&key, &value)?).is_none(),
            "z_max" => z_max.replace(number(&key, &value)?).is_none(),
            "res" => resolution.replace(number(&key, &value)?).is_none(),
            "region" => region.replace(corners(&value)?).is_none(),
            "field" => shown.replace(one_of(&key, &value, &SHOWN)?).is_none(),
            "robot_radius" => radius.replace(number(&key, &value)?).is_none(),
            "inflation" => inflation.replace(number(&key, &value)?).is_none(),
            "min_epoch" => options.min_epoch.replace(number(&key, &value)?).is_none(),
            "max_age_ms" => options.max_age_ms.replace(number(&key, &value)?).is_none(),
            "unknown_policy" => {
                options.unknown_policy.replace(one_of(&key, &value, &POLICIES)?).is_none()
            }
            "unknown_distance_m" => {
                options.unknown_distance_m.replace(number(&key, &value)?).is_none()
            }
            _ => {
                let shown: String = key.chars().take(64).collect();
                let known = "z, z_max, res, region, field, robot_radius, inflation, min_epoch, \
                             max_age_ms, unknown_policy, unknown_distance_m";
                return Err(Error::invalid(shown, format!("is none of {known}")).into());
            }
        };
        if !is_first {
            return Err(Error::invalid(key, "is there twice").into());
        }
    }
    options.check()?;
    let required = |key: &str, value: Option<f32>| {
        value.ok_or_else(|| Refusal::from(Error::invalid(key, "is required")))
    };
    let costs = match shown {
        Some(Shown::Cost) => Some(Costs {
            robot_radius_m: radius.unwrap_or_default(),
            inflation_m: required("inflation", inflation)?,
        }),
        _ => None,
    };
    Ok(SliceQuestion {
        terms: options.terms(map_id),
        z_m: required("z", z)?,
        z_max_m: z_max,
        resolution_m: required("res", resolution)?,
        region,
        costs,
    })
}

/// x0,y0,x1,y1.
fn corners(text: &str) -> Result<Aabb, Refusal> {
    let numbers = text.split(',').map(|part| number("region", part));
    let numbers = numbers.collect::<Result<Vec<f32>, Refusal>>()?;
    let [x0, y0, x1, y1] = numbers[..] else {
        return Err(Error::invalid("region", "needs four numbers: x0,y0,x1,y1").into());
    };
    Ok(Aabb { min: Vec3::new(x0, y0, 0.0), max: Vec3::new(x1, y1, 0.0) })
}

fn picture(level: &Level) -> Result<Bytes, Refusal> {
    let image = if level.cost.is_empty() {
        DynamicImage::from(draw_slice(&level.shape.picture(&level.distance_m)?))
    } else {
        let (width, height) = (level.shape.width, level.shape.height);
        // The first row is the lowest.
        let at = |x: u32, y: u32| level.cost[(x + (height - 1 - y) * width) as usize];
        DynamicImage::from(GrayImage::from_fn(width, height, |x, y| Luma([grey(at(x, y))])))
    };
    let mut bytes = Cursor::new(Vec::new());
    image
        .write_to(&mut bytes, ImageFormat::Png)
        .map_err(|e| Error::Internal(format!("a slice was not drawn: {e}")))?;
    Ok(Bytes::from(bytes.into_inner()))
}

/// A cost as map files of ROS have it.
fn grey(cost: i8) -> u8 {
    if cost < 0 { 205 } else { (254 - (254 * u32::from(cost.unsigned_abs()) + 50) / 100) as u8 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_query_string_is_read_or_refused_by_key() {
        let read = |text: &str| question("default".into(), Some(text));
        let plain = read("z=0.5&res=0.05").expect("all that is needed");
        assert_eq!((plain.z_m, plain.resolution_m, plain.costs), (0.5, 0.05, None));
        let all =
            read("z=0&z_max=1&res=0.1&region=-1,-2,3,4&field=cost&robot_radius=0.2&inflation=0.5");
        let all = all.expect("good");
        assert_eq!(all.costs, Some(Costs { robot_radius_m: 0.2, inflation_m: 0.5 }));
        assert_eq!(all.region.map(|r| r.max), Some(Vec3::new(3.0, 4.0, 0.0)));
        for (text, words) in [
            ("res=0.1", "z: is required"),
            ("z=0", "res: is required"),
            ("z=a&res=1", "'a'"),
            ("z=0&res=1&z=0", "twice"),
            ("z=0&res=1&region=1,2,3", "region: needs four"),
            ("z=0&res=1&field=heat", "field: 'heat'"),
            ("z=0&res=1&field=cost", "inflation: is required"),
            ("z=0&res=1&depth=1", "depth: is none of z, z_max"),
        ] {
            let problem = format!("{:?}", read(text).expect_err(text));
            assert!(problem.contains(words), "{words} in {problem}");
        }
        assert_eq!([grey(-1), grey(0), grey(50), grey(100)], [205, 254, 127, 0]);
    }
}
