//! Images of a map: a place and a camera in JSON, one image back.

use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, header};
use axum::response::Response;
use bytes::Bytes;
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::body::{Most, Parts, receive};
use super::language::Text;
use super::media::Media;
use super::openapi::{self, ImageRefusals};
use super::options::check_integer;
use super::parse::{parse, pixels, whole};
use super::refusal::Refusal;
use super::{Edge, MapId, schemas};
use crate::config::Renderer;
use crate::error::Error;
use crate::geometry::{Intrinsics, Pose};
use crate::map::{Camera, Encoding, Output};
use crate::service::{Call, ImageKind, ImageQuestion};
use crate::wire::{EPOCH, HEIGHT, NEWEST_STAMP_NS, SERVER_US, WIDTH};

/// The largest body: a dozen numbers, and words or fifty embeddings of a thousand numbers.
const BODY_BYTES: usize = 1 << 20;

/// A place and a camera.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct RenderRequest {
    world_from_camera: CameraPose,
    intrinsics: CameraIntrinsics,
    /// What the image shows: the color by default.
    output: Option<ImageOutput>,
    /// Left out: what `accept` likes best, `image/png`, `image/jpeg` or, for f32,
    /// `application/octet-stream`; PNG if it has no preference.
    encoding: Option<ImageEncoding>,
    #[serde(default, deserialize_with = "whole")]
    #[schema(schema_with = schemas::jpeg_quality)]
    jpeg_quality: Option<u64>,
    /// `tile` by default, which is fast; `ray` is the reference.
    renderer: Option<ImageRenderer>,
    /// What `heat` is the heat of.
    text: Option<Text>,
    #[serde(default, deserialize_with = "whole")]
    #[schema(schema_with = schemas::min_epoch)]
    min_epoch: Option<u64>,
    #[serde(default, deserialize_with = "whole")]
    #[schema(schema_with = schemas::max_age)]
    max_age_ms: Option<u64>,
}

/// Where the camera is and where it looks: p_world = rotation · p_camera + translation. Camera axes
/// are optical: x right, y down, z forward.
#[derive(Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct CameraPose {
    #[schema(schema_with = schemas::translation)]
    translation: [f64; 3],
    #[schema(schema_with = schemas::rotation)]
    rotation: [f64; 4],
}

/// A pinhole camera without distortion, in pixels; an integer pixel is a pixel's centre.
#[derive(Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct CameraIntrinsics {
    #[schema(minimum = 0.01, maximum = 1e6)]
    fx: f64,
    #[schema(minimum = 0.01, maximum = 1e6)]
    fy: f64,
    #[schema(minimum = -1e6, maximum = 1e6)]
    cx: f64,
    #[schema(minimum = -1e6, maximum = 1e6)]
    cy: f64,
    #[serde(deserialize_with = "pixels")]
    #[schema(minimum = 1, maximum = 4096)]
    width: u32,
    #[serde(deserialize_with = "pixels")]
    #[schema(minimum = 1, maximum = 4096)]
    height: u32,
}

impl From<Pose> for CameraPose {
    fn from(pose: Pose) -> Self {
        Self { translation: pose.translation.to_array(), rotation: pose.rotation.to_array() }
    }
}

impl From<Intrinsics> for CameraIntrinsics {
    fn from(k: Intrinsics) -> Self {
        Self { fx: k.fx, fy: k.fy, cx: k.cx, cy: k.cy, width: k.width, height: k.height }
    }
}

/// What an image shows: `color` in sRGB, black where there is none; `depth` along the optical axis, 0
/// where there is no surface; `normal`, world axes, towards the camera's side; `opacity`, how much
/// light the ray lost; `unknown`, whether the ray left what was observed before it met a surface; `heat`,
/// how well `text` fits.
#[derive(Debug, Clone, Copy, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
enum ImageOutput {
    Color,
    Depth,
    Normal,
    Opacity,
    Unknown,
    Heat,
}

/// `png`: 8 bits a channel (normals as 0..255 for -1..1, unknown as 0 or 255), depth as 16-bit grey in
/// millimetres; `jpeg`: color alone; `f32`: little-endian numbers, row by row, channels side by side,
/// depth in metres; `u8`: the same in bytes, 0 or 1 for unknown, not for depth.
#[derive(Debug, Clone, Copy, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
enum ImageEncoding {
    Png,
    Jpeg,
    F32,
    U8,
}

#[derive(Debug, Clone, Copy, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
enum ImageRenderer {
    Tile,
    Ray,
}

/// An image of the map from any place
///
/// Width times height is at most `server.max_pixels`. The image comes from one epoch and is drawn
/// without waiting for the mapper, one image at a time.
#[utoipa::path(post, path = "/v1/maps/{map}/render", tag = "render",
    params(openapi::MapPath),
    request_body = RenderRequest,
    responses((status = 200, description = "The image.",
        content((openapi::Raw = "image/png"), (openapi::Raw = "image/jpeg"),
            (openapi::Raw = "application/octet-stream")),
        headers(
            ("orenx-width" = u32, description = "Pixels a row."),
            ("orenx-height" = u32, description = "Rows."),
            ("orenx-epoch" = u64, description = "The epoch that was drawn."),
            ("orenx-newest-stamp-ns" = i64, description = "The capture time of its newest frame, \
                Unix ns."),
            ("orenx-server-us" = u64, description = "Time spent in the server, microseconds."))),
        ImageRefusals))]
pub(super) async fn render(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
    request: Request,
) -> Result<Response, Refusal> {
    let service = edge.service()?;
    service.map_detail(&map_id)?;
    Media::json_body(request.headers())?;
    let (head, body) = request.into_parts();
    let most = Most { bytes: BODY_BYTES, what: "one camera".into() };
    let received = receive::<u8>(body, most, &edge.limits, &edge.memory).await?;
    let question = question(map_id, &head.headers, parse(&received.values)?)?;
    // The most that it can take, before it is drawn for nothing.
    let mut share = received.share;
    share.grow(received.bytes + question.bytes().min(edge.limits.image_bytes))?;
    let reply = service.render(question, Call::HttpRender).await?;
    let (kind, image) = reply
        .images
        .into_iter()
        .next()
        .ok_or_else(|| Error::Internal("an image was asked for, and none came".into()))?;
    let mut response = Response::new(Body::new(Parts::new(vec![Bytes::from(image)], share)));
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(media_type(kind.encoding)));
    let name = HeaderName::from_static;
    headers.insert(name(WIDTH), HeaderValue::from(reply.width));
    headers.insert(name(HEIGHT), HeaderValue::from(reply.height));
    headers.insert(name(EPOCH), HeaderValue::from(reply.epoch));
    headers.insert(name(NEWEST_STAMP_NS), HeaderValue::from(reply.newest_stamp_ns));
    headers.insert(name(SERVER_US), HeaderValue::from(reply.spent.as_micros() as u64));
    Ok(response)
}

fn question(
    map_id: String,
    headers: &HeaderMap,
    request: RenderRequest,
) -> Result<ImageQuestion, Refusal> {
    check_integer("min_epoch", request.min_epoch)?;
    check_integer("max_age_ms", request.max_age_ms)?;
    let CameraPose { translation, rotation } = request.world_from_camera;
    let k = request.intrinsics;
    let intrinsics =
        Intrinsics { fx: k.fx, fy: k.fy, cx: k.cx, cy: k.cy, width: k.width, height: k.height };
    let camera = Camera {
        world_from_camera: Pose::from_quaternion(
            DQuat::from_array(rotation),
            DVec3::from_array(translation),
        )?,
        intrinsics,
    };
    let output = match request.output {
        None | Some(ImageOutput::Color) => Output::Color,
        Some(ImageOutput::Depth) => Output::Depth,
        Some(ImageOutput::Normal) => Output::Normal,
        Some(ImageOutput::Opacity) => Output::Opacity,
        Some(ImageOutput::Unknown) => Output::Unknown,
        Some(ImageOutput::Heat) => Output::Heat,
    };
    let encoding = encoding(headers, output, request.encoding)?;
    let encoding = with_quality(encoding, request.jpeg_quality)?;
    encoding.check(output, "encoding")?;
    Ok(ImageQuestion {
        map_id,
        renderer: match request.renderer {
            None | Some(ImageRenderer::Tile) => Renderer::Tile,
            Some(ImageRenderer::Ray) => Renderer::Ray,
        },
        text: request.text.map(Text::sought).transpose()?,
        min_epoch: request.min_epoch.unwrap_or_default(),
        max_age: request.max_age_ms.filter(|ms| *ms > 0).map(Duration::from_millis),
        ..ImageQuestion::new(camera, vec![ImageKind { output, encoding }])
    })
}

/// What the body asks for, or else what `accept` likes best of what the output has.
fn encoding(
    headers: &HeaderMap,
    output: Output,
    asked: Option<ImageEncoding>,
) -> Result<Encoding, Refusal> {
    Ok(match asked {
        Some(ImageEncoding::Png) => Encoding::Png,
        Some(ImageEncoding::Jpeg) => Encoding::JPEG,
        Some(ImageEncoding::F32) => Encoding::F32,
        Some(ImageEncoding::U8) => Encoding::U8,
        None => {
            let mut all = vec![Encoding::Png, Encoding::JPEG, Encoding::F32];
            all.retain(|encoding| encoding.check(output, "").is_ok());
            let types: Vec<&str> = all.iter().map(|encoding| media_type(*encoding)).collect();
            all[Media::best(headers, &types)?]
        }
    })
}

fn with_quality(encoding: Encoding, quality: Option<u64>) -> Result<Encoding, Refusal> {
    let Some(quality) = quality else { return Ok(encoding) };
    let wrong = |problem: String| Err(Error::invalid("jpeg_quality", problem).into());
    match (encoding, u8::try_from(quality)) {
        (Encoding::Jpeg { .. }, Ok(quality @ 1..=100)) => Ok(Encoding::Jpeg { quality }),
        (Encoding::Jpeg { .. }, _) => wrong(format!("{quality} must be within 1..=100")),
        _ => wrong(format!("{quality} needs encoding jpeg")),
    }
}

fn media_type(encoding: Encoding) -> &'static str {
    match encoding {
        Encoding::Png => "image/png",
        Encoding::Jpeg { .. } => "image/jpeg",
        Encoding::F32 | Encoding::U8 => "application/octet-stream",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = r#"{"world_from_camera":{"translation":[1,2,3],"rotation":[0,0,0,1]},
        "intrinsics":{"fx":9,"fy":9.5,"cx":3.5,"cy":2.5,"width":8,"height":6.0}}"#;

    fn ask(accept: &'static str, more: &str) -> Result<ImageQuestion, String> {
        let headers = match accept {
            "" => HeaderMap::new(),
            _ => HeaderMap::from_iter([(header::ACCEPT, HeaderValue::from_static(accept))]),
        };
        let body = format!("{}{more}}}", GOOD.strip_suffix('}').expect("an object"));
        let asked = parse(body.as_bytes()).and_then(|r| question("default".into(), &headers, r));
        asked.map_err(|refusal| format!("{refusal:?}"))
    }

    #[test]
    fn a_camera_is_enough() {
        let asked = ask("", "").expect("good");
        let kind = ImageKind { output: Output::Color, encoding: Encoding::Png };
        assert_eq!((asked.images, asked.renderer), (vec![kind], Renderer::Tile));
        assert_eq!(asked.camera.world_from_camera.translation, DVec3::new(1.0, 2.0, 3.0));
        assert_eq!((asked.camera.intrinsics.width, asked.camera.intrinsics.height), (8, 6));
        let asked = ask("", r#","output":"depth","renderer":"ray","min_epoch":4,"max_age_ms":9"#);
        let asked = asked.expect("good");
        assert_eq!((asked.images[0].output, asked.renderer), (Output::Depth, Renderer::Ray));
        assert_eq!((asked.min_epoch, asked.max_age), (4, Some(Duration::from_millis(9))));
    }

    #[test]
    fn the_encoding_is_the_bodys_or_what_the_client_likes() {
        let encoding = |accept, more| ask(accept, more).map(|q| q.images[0].encoding).ok();
        assert_eq!(encoding("*/*", ""), Some(Encoding::Png));
        assert_eq!(encoding("image/*", ""), Some(Encoding::Png));
        assert_eq!(encoding("image/jpeg", ""), Some(Encoding::JPEG));
        assert_eq!(encoding("image/jpeg;q=0.5, image/png;q=0.4", ""), Some(Encoding::JPEG));
        assert_eq!(encoding("application/octet-stream", ""), Some(Encoding::F32));
        assert_eq!(encoding("text/html", ""), None);
        assert_eq!(encoding("image/jpeg", r#","output":"depth""#), None);
        let either = encoding("image/jpeg, image/*;q=0.1", r#","output":"depth""#);
        assert_eq!(either, Some(Encoding::Png), "depth has no JPEG");
        assert_eq!(encoding("text/html", r#","encoding":"u8""#), Some(Encoding::U8));
        let fifty = Some(Encoding::Jpeg { quality: 50 });
        assert_eq!(encoding("image/jpeg", r#","jpeg_quality":50"#), fifty);
        assert_eq!(encoding("", r#","encoding":"jpeg","jpeg_quality":50.0"#), fifty);
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (more, words) in [
            (r#","encoding":"png","jpeg_quality":50"#, ["jpeg_quality: ", "needs encoding jpeg"]),
            (r#","encoding":"jpeg","jpeg_quality":0"#, ["jpeg_quality: ", "1..=100"]),
            (r#","encoding":"jpeg","jpeg_quality":256"#, ["jpeg_quality: ", "1..=100"]),
            (r#","encoding":"jpeg","output":"depth""#, ["encoding: ", "not for depth"]),
            (r#","encoding":"gif""#, ["encoding: ", "gif"]),
            (r#","output":"warmth""#, ["output: ", "warmth"]),
            (r#","min_epoch":-1"#, ["min_epoch: ", "-1"]),
            (r#","pose":1"#, ["pose: ", "unknown field"]),
        ] {
            let refusal = ask("", more).expect_err(more);
            for word in words {
                assert!(refusal.contains(word), "{word} in {refusal}");
            }
        }
        let headers = HeaderMap::new();
        for (from, to, words) in [
            ("[0,0,0,1]", "[0,0,0,2]", ["world_from_camera.rotation: ", "length 2"]),
            ("[0,0,0,1]", "[0,0,0]", ["world_from_camera.rotation: ", "length 3"]),
            ("[1,2,3]", "[1,2,\"3\"]", ["world_from_camera.translation[2]: ", "string"]),
            ("\"width\":8", "\"width\":8.5", ["intrinsics.width: ", "8.5"]),
            ("\"width\":8", "\"width\":null", ["intrinsics.width: ", "whole"]),
            ("\"fx\":9,", "", ["intrinsics: ", "missing field `fx`"]),
        ] {
            let body = GOOD.replace(from, to);
            let asked = parse(body.as_bytes()).and_then(|r| question(String::new(), &headers, r));
            let refusal = format!("{:?}", asked.expect_err(to));
            for word in words {
                assert!(refusal.contains(word), "{word} in {refusal}");
            }
        }
    }
}
