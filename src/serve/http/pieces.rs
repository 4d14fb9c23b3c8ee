//! The surface for pages that draw it, in pieces as it grows, and as a file.

use std::sync::Arc;

use axum::body::Body;
use axum::extract::{RawQuery, State};
use axum::http::{HeaderName, HeaderValue, header};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use utoipa::ToSchema;

use super::body::Parts;
use super::openapi::{self, MapRefusals};
use super::options::{check_integer, decoded, number, one_of};
use super::refusal::Refusal;
use super::{Edge, MapId};
use crate::error::Error;
use crate::map::{Detail, MeshFormat};
use crate::service::{PiecesQuestion, PiecesReply};
use crate::wire::{EPOCH, NEWEST_STAMP_NS, SERVER_US};

/// How an answer begins.
const MAGIC: [u8; 4] = *b"OXP1";
const IS_FRESH: u32 = 1;
const HAS_MORE: u32 = 2;

/// How finely: vertices as far apart as level-0 voxels, half, or a quarter of that.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ToSchema)]
#[schema(rename_all = "lowercase")]
#[expect(dead_code, reason = "stands for a word in the document")]
enum DetailName {
    Coarse,
    Medium,
    Fine,
}

const DETAILS: [(&str, Detail); 3] =
    [("coarse", Detail::Coarse), ("medium", Detail::Medium), ("fine", Detail::Fine)];

/// What is known already; a key that does not exist, or twice, is refused.
#[derive(utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[expect(dead_code, reason = "stands for the query string in the document")]
pub(super) struct PiecesQuery {
    /// As the last answer has it; 0 at first.
    #[param(maximum = 9_007_199_254_740_991_u64)]
    generation: Option<u64>,
    /// The change that the last answer says to go on from; 0 at first.
    #[param(maximum = 9_007_199_254_740_991_u64)]
    since: Option<u64>,
    /// `medium` by default. Other pieces than those of another detail: go on from 0.
    #[param(inline)]
    detail: Option<DetailName>,
    /// About what the pieces of the answer may have; one piece always fits.
    #[param(minimum = 65_536, maximum = 8_388_608)]
    max_bytes: Option<usize>,
}

/// How fine a file is; a key that does not exist, or twice, is refused.
#[derive(utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[expect(dead_code, reason = "stands for the query string in the document")]
pub(super) struct MeshQuery {
    /// Distance between vertices, m; left out, half of r0.
    #[param(minimum = 0.001, maximum = 1.0)]
    resolution: Option<f32>,
}

/// The surface in pieces, those that changed
///
/// The map is cut into cubes, and each has the number of its last change. An answer has what changed
/// after `since`, the oldest change first, as much as `max_bytes` allows. Little-endian, at multiples of
/// four:
///
/// - head, 48 bytes: `OXP1`, pieces u32, generation u64, next u64 (the `since` to ask with), epoch u64,
///   edge of a piece f32 and distance between vertices f32 in metres, flags u32 (1: what was told before
///   is void, 2: there is more, ask again at once), 0 u32;
/// - a piece: key i32×3 (its low corner is that many edges from the origin), vertices u32, triangles u32,
///   flags u32 (1: has colours, 2: wide indices);
/// - its vertices, u16×4: place within the piece, 0 to 65535, and the normal as two bytes of an unfolded
///   octahedron, the first one lower;
/// - if it has colours, u8×4 a vertex: sRGB, and 255 where it is known;
/// - its triangles, three indices u16 or, if wide, u32, and padding.
///
/// A piece without triangles is empty now.
#[utoipa::path(get, path = "/v1/maps/{map}/mesh/pieces", tag = "render",
    params(openapi::MapPath, PiecesQuery),
    responses((status = 200, description = "Pieces.",
        content((openapi::Raw = "application/octet-stream"))), MapRefusals))]
pub(super) async fn pieces(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
    RawQuery(query): RawQuery,
) -> Result<Response, Refusal> {
    let service = edge.service()?;
    service.map_detail(&map_id)?;
    let question = question(map_id, query.as_deref())?;
    let share = edge.share(question.max_bytes)?;
    let reply = service.pieces(question).await?;
    let epoch = HeaderValue::from(reply.epoch);
    let head = Bytes::from(head(&reply));
    let parts = reply.pieces.into_iter().map(Bytes::from_owner);
    let body = Parts::new([head].into_iter().chain(parts).collect(), share);
    let mut response = Response::new(Body::new(body));
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/octet-stream"));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    headers.insert(HeaderName::from_static(EPOCH), epoch);
    Ok(response)
}

fn head(reply: &PiecesReply) -> Vec<u8> {
    let flags = (u32::from(reply.is_fresh) * IS_FRESH) | (u32::from(reply.has_more) * HAS_MORE);
    let mut head = MAGIC.to_vec();
    head.extend((reply.pieces.len() as u32).to_le_bytes());
    [reply.generation, reply.next, reply.epoch].iter().for_each(|n| head.extend(n.to_le_bytes()));
    [reply.piece_m, reply.resolution_m].iter().for_each(|x| head.extend(x.to_le_bytes()));
    [flags, 0].iter().for_each(|n| head.extend(n.to_le_bytes()));
    head
}

fn question(map_id: String, query: Option<&str>) -> Result<PiecesQuestion, Refusal> {
    let (mut generation, mut since, mut detail, mut max_bytes) = (None, None, None, None);
    for pair in query.unwrap_or_default().split('&').filter(|pair| !pair.is_empty()) {
        let (key, value) = pair.split_once('=').unwrap_or((pair, ""));
        let (key, value) = (decoded(key)?, decoded(value)?);
        let is_first = match key.as_str() {
            "generation" => generation.replace(number(&key, &value)?).is_none(),
            "since" => since.replace(number(&key, &value)?).is_none(),
            "detail" => detail.replace(one_of(&key, &value, &DETAILS)?).is_none(),
            "max_bytes" => max_bytes.replace(number(&key, &value)?).is_none(),
            _ => return Err(unknown(&key, "generation, since, detail, max_bytes")),
        };
        if !is_first {
            return Err(Error::invalid(key, "is there twice").into());
        }
    }
    check_integer("generation", generation)?;
    check_integer("since", since)?;
    let usual = PiecesQuestion::default();
    Ok(PiecesQuestion {
        map_id,
        generation: generation.unwrap_or_default(),
        since: since.unwrap_or_default(),
        detail: detail.unwrap_or(usual.detail),
        max_bytes: max_bytes.unwrap_or(usual.max_bytes),
    })
}

fn unknown(key: &str, known: &str) -> Refusal {
    let shown: String = key.chars().take(64).collect();
    Error::invalid(shown, format!("is none of {known}")).into()
}

/// The surface as a PLY file
///
/// Metres; normals and colours at the vertices, triangles counter-clockwise as seen from free space.
#[utoipa::path(get, path = "/v1/maps/{map}/mesh.ply", tag = "render",
    params(openapi::MapPath, MeshQuery),
    responses((status = 200, description = "The file.",
        content((openapi::Raw = "application/octet-stream"))), MapRefusals))]
pub(super) async fn ply(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
    RawQuery(query): RawQuery,
) -> Result<Response, Refusal> {
    file(&edge, map_id, query.as_deref(), MeshFormat::Ply).await
}

/// The surface as a GLB file
///
/// Binary glTF 2.0, which browsers, Blender and engines open: metres, y up, normals and colours at the
/// vertices, without light of its own.
#[utoipa::path(get, path = "/v1/maps/{map}/mesh.glb", tag = "render",
    params(openapi::MapPath, MeshQuery),
    responses((status = 200, description = "The file.",
        content((openapi::Raw = "model/gltf-binary"))), MapRefusals))]
pub(super) async fn glb(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
    RawQuery(query): RawQuery,
) -> Result<Response, Refusal> {
    file(&edge, map_id, query.as_deref(), MeshFormat::Glb).await
}

async fn file(
    edge: &Edge,
    map_id: String,
    query: Option<&str>,
    format: MeshFormat,
) -> Result<Response, Refusal> {
    let service = edge.service()?;
    service.map_detail(&map_id)?;
    let mut resolution_m = None;
    for pair in query.unwrap_or_default().split('&').filter(|pair| !pair.is_empty()) {
        let (key, value) = pair.split_once('=').unwrap_or((pair, ""));
        let (key, value) = (decoded(key)?, decoded(value)?);
        if key != "resolution" {
            return Err(unknown(&key, "resolution"));
        }
        if resolution_m.replace(number(&key, &value)?).is_some() {
            return Err(Error::invalid(key, "is there twice").into());
        }
    }
    let reply = service.mesh_file(&map_id, format, resolution_m).await?;
    let share = edge.share(reply.answer.len())?;
    let body = Parts::new(vec![Bytes::from(reply.answer)], share);
    let name = HeaderName::from_static;
    // Ids of maps are words of letters, digits and a few marks.
    let (ending, media) = match format {
        MeshFormat::Ply => ("ply", "application/octet-stream"),
        MeshFormat::Glb => ("glb", "model/gltf-binary"),
    };
    let file = format!("attachment; filename=\"{map_id}.{ending}\"");
    let mut response = Response::new(Body::new(body));
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(media));
    if let Ok(file) = HeaderValue::from_str(&file) {
        headers.insert(header::CONTENT_DISPOSITION, file);
    }
    headers.insert(name(EPOCH), HeaderValue::from(reply.epoch));
    headers.insert(name(NEWEST_STAMP_NS), HeaderValue::from(reply.newest_stamp_ns));
    headers.insert(name(SERVER_US), HeaderValue::from(reply.spent.as_micros() as u64));
    Ok(response.into_response())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_query_is_read_and_its_mistakes_are_named() {
        let read = |query| question("hall".into(), Some(query));
        let good = read("since=7&generation=9&detail=fine&max_bytes=65536").expect("good");
        let expected = PiecesQuestion {
            map_id: "hall".into(),
            generation: 9,
            since: 7,
            detail: Detail::Fine,
            max_bytes: 65536,
        };
        assert_eq!(good, expected);
        for (query, part) in [
            ("since=-1", "since"),
            ("since=9007199254740992", "since"),
            ("detail=finest", "none of coarse, medium, fine"),
            ("since=1&since=2", "twice"),
            ("epoch=1", "is none of"),
        ] {
            let problem = format!("{:?}", read(query).expect_err(query));
            assert!(problem.contains(part), "{query}: {problem}");
        }
    }

    #[test]
    fn the_head_has_its_numbers_where_the_document_says() {
        let reply = PiecesReply {
            generation: 2,
            is_fresh: true,
            next: 3,
            has_more: true,
            epoch: 4,
            piece_m: 1.5,
            resolution_m: 0.25,
            pieces: vec![Arc::from([0u8; 4])],
        };
        let head = head(&reply);
        assert_eq!((head.len(), &head[..8]), (48, &b"OXP1\x01\0\0\0"[..]));
        assert_eq!((head[8], head[16], head[24]), (2, 3, 4));
        assert_eq!((&head[32..36], &head[40..44]), (&1.5f32.to_le_bytes()[..], &[3, 0, 0, 0][..]));
    }
}
