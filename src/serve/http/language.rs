//! Questions in words or embeddings, in JSON: where something is, and which class places have.

use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::header;
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use glam::Vec3;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::body::{Most, Parts, Received, Share, receive};
use super::found::TextAnswer;
use super::media::Media;
use super::openapi::{self, MapRefusals, PointRefusals};
use super::options::check_integer;
use super::parse::{parse, whole};
use super::points::off_thread;
use super::refusal::Refusal;
use super::{Edge, JSON, MapId, json, schemas};
use crate::error::Error;
use crate::frame::Contract;
use crate::geometry::Aabb;
use crate::service::{Call, ClassifyQuestion, FindQuestion, Sought};

/// The largest body of words, and of embeddings: 128 of 4096 numbers.
const WORDS_BYTES: usize = 1 << 20;
const EMBEDDINGS_BYTES: usize = 16 << 20;
/// About what a class takes in a JSON answer, bytes.
const CLASS_BYTES: usize = 24;
/// And what a place with its score takes.
const PLACE_BYTES: usize = 48;

/// What places are compared with: words, or embeddings of the map's encoder. Scores are relevancies,
/// within 0..1, where there are negatives, and cosines where there are none. Of several prompts the best
/// counts.
#[derive(Debug, Clone, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Text {
    #[schema(schema_with = schemas::words_or_null)]
    prompts: Option<Vec<String>>,
    #[schema(schema_with = schemas::negatives)]
    negatives: Option<Vec<String>>,
    /// The encoder that embeddings come from.
    encoder_id: Option<String>,
    #[schema(schema_with = schemas::embeddings_or_null)]
    prompt_embeddings: Option<Vec<Vec<f32>>>,
    #[schema(schema_with = schemas::negative_embeddings)]
    negative_embeddings: Option<Vec<Vec<f32>>>,
}

impl Text {
    pub(super) fn sought(self) -> Result<Sought, Refusal> {
        let Self { prompts, negatives, encoder_id, prompt_embeddings, negative_embeddings } = self;
        let has_words = prompts.is_some() || negatives.is_some();
        let has_numbers =
            encoder_id.is_some() || prompt_embeddings.is_some() || negative_embeddings.is_some();
        if has_words && has_numbers {
            return Err(Error::invalid("text", "has words and embeddings; send either").into());
        }
        Ok(match has_numbers {
            false => Sought::Words { prompts: prompts.unwrap_or_default(), negatives },
            true => Sought::Embeddings {
                encoder_id: encoder_id.unwrap_or_default(),
                prompts: prompt_embeddings.unwrap_or_default(),
                negatives: negative_embeddings.unwrap_or_default(),
            },
        })
    }
}

/// What is looked for in the whole map, in words.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct TextRequest {
    #[schema(schema_with = schemas::words)]
    prompts: Vec<String>,
    #[schema(schema_with = schemas::negatives)]
    negatives: Option<Vec<String>>,
    region: Option<Region>,
    #[schema(schema_with = schemas::min_score)]
    min_score: Option<f32>,
    #[serde(default, deserialize_with = "whole")]
    #[schema(schema_with = schemas::top_k)]
    top_k: Option<u64>,
    /// Answer every place that counts too, with its score; with a `min_score` of -1 the whole map.
    places: Option<bool>,
    #[serde(default, deserialize_with = "whole")]
    #[schema(schema_with = schemas::min_epoch)]
    min_epoch: Option<u64>,
    #[serde(default, deserialize_with = "whole")]
    #[schema(schema_with = schemas::max_age)]
    max_age_ms: Option<u64>,
}

/// The same in embeddings of the map's encoder.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct EmbeddingRequest {
    encoder_id: String,
    #[schema(schema_with = schemas::embeddings)]
    prompts: Vec<Vec<f32>>,
    #[schema(schema_with = schemas::negative_embeddings)]
    negatives: Option<Vec<Vec<f32>>>,
    region: Option<Region>,
    #[schema(schema_with = schemas::min_score)]
    min_score: Option<f32>,
    #[serde(default, deserialize_with = "whole")]
    #[schema(schema_with = schemas::top_k)]
    top_k: Option<u64>,
    /// Answer every place that counts too, with its score; with a `min_score` of -1 the whole map.
    places: Option<bool>,
    #[serde(default, deserialize_with = "whole")]
    #[schema(schema_with = schemas::min_epoch)]
    min_epoch: Option<u64>,
    #[serde(default, deserialize_with = "whole")]
    #[schema(schema_with = schemas::max_age)]
    max_age_ms: Option<u64>,
}

/// A box, world metres: what lies outside does not count.
#[derive(Debug, Clone, Copy, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct Region {
    #[schema(schema_with = schemas::corner)]
    min: Vec3,
    #[schema(schema_with = schemas::corner)]
    max: Vec3,
}

/// Points, and classes by name or as embeddings of the map's encoder.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct ClassifyRequest {
    #[schema(schema_with = schemas::points)]
    points_m: Vec<Vec3>,
    #[schema(schema_with = schemas::class_names)]
    classes: Option<Vec<String>>,
    /// The encoder that embeddings come from.
    encoder_id: Option<String>,
    #[schema(schema_with = schemas::embeddings_or_null)]
    class_embeddings: Option<Vec<Vec<f32>>>,
    #[serde(default, deserialize_with = "whole")]
    #[schema(schema_with = schemas::min_epoch)]
    min_epoch: Option<u64>,
    #[serde(default, deserialize_with = "whole")]
    #[schema(schema_with = schemas::max_age)]
    max_age_ms: Option<u64>,
}

/// In the order of the points.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct ClassifyAnswer {
    /// The place of the class in the request, from 0; -1 where nothing was seen with features.
    class: Vec<i32>,
    #[schema(schema_with = schemas::class_scores)]
    score: Vec<f32>,
    /// The encoder of the map.
    encoder_id: String,
    /// The epoch that answered.
    epoch: u64,
    /// The capture time of its newest frame, Unix ns.
    newest_stamp_ns: i64,
    /// Time spent in the server, microseconds.
    server_us: u64,
}

/// Who embeds.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct EncodersAnswer {
    /// What embeds words and the names of classes here; null where nothing does.
    #[schema(required = true)]
    server: Option<Encoder>,
    /// That of the map's features; null before the first frame with features.
    #[schema(required = true)]
    map: Option<Encoder>,
    /// The newest epoch.
    epoch: u64,
    /// The capture time of its newest frame, Unix ns.
    newest_stamp_ns: i64,
    /// Time spent in the server, microseconds.
    server_us: u64,
}

#[derive(Debug, Serialize, ToSchema)]
struct Encoder {
    /// Names the encoder and its version.
    encoder_id: String,
    /// Numbers of an embedding.
    dimension: usize,
}

/// Where is what the words mean?
///
/// The server's text encoder embeds the words; one that is not the map's is refused, with both names.
#[utoipa::path(post, path = "/v1/maps/{map}/query/text", tag = "language",
    params(openapi::MapPath),
    request_body = TextRequest,
    responses((status = 200, description = "What was found.", body = TextAnswer), PointRefusals))]
pub(super) async fn text(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
    request: Request,
) -> Result<Response, Refusal> {
    let most = Most { bytes: WORDS_BYTES, what: "words".into() };
    let (asked, share) = read::<TextRequest>(&edge, &map_id, request, most).await?;
    let sought = Sought::Words { prompts: asked.prompts, negatives: asked.negatives };
    let settings = (asked.region, asked.min_score, asked.top_k, asked.places);
    let newness = (asked.min_epoch, asked.max_age_ms);
    let question = question(map_id, sought, settings, newness)?;
    answer(&edge, question, Call::HttpQueryText, share).await
}

/// Where is what the embeddings mean?
#[utoipa::path(post, path = "/v1/maps/{map}/query/embedding", tag = "language",
    params(openapi::MapPath),
    request_body = EmbeddingRequest,
    responses((status = 200, description = "What was found.", body = TextAnswer), PointRefusals))]
pub(super) async fn embedding(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
    request: Request,
) -> Result<Response, Refusal> {
    let most = Most { bytes: EMBEDDINGS_BYTES, what: "embeddings".into() };
    let (asked, share) = read::<EmbeddingRequest>(&edge, &map_id, request, most).await?;
    let sought = Sought::Embeddings {
        encoder_id: asked.encoder_id,
        prompts: asked.prompts,
        negatives: asked.negatives.unwrap_or_default(),
    };
    let settings = (asked.region, asked.min_score, asked.top_k, asked.places);
    let newness = (asked.min_epoch, asked.max_age_ms);
    let question = question(map_id, sought, settings, newness)?;
    answer(&edge, question, Call::HttpQueryEmbedding, share).await
}

/// Which of some classes is at each point?
#[utoipa::path(post, path = "/v1/maps/{map}/classify", tag = "language",
    params(openapi::MapPath),
    request_body = ClassifyRequest,
    responses((status = 200, description = "Classes.", body = ClassifyAnswer), PointRefusals))]
pub(super) async fn classify(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
    request: Request,
) -> Result<Response, Refusal> {
    let limits = &edge.limits;
    let most = Most::points(limits.json_bytes + EMBEDDINGS_BYTES, limits.max_points);
    let (asked, share) = read::<ClassifyRequest>(&edge, &map_id, request, most).await?;
    check_integer("min_epoch", asked.min_epoch)?;
    check_integer("max_age_ms", asked.max_age_ms)?;
    let classes = match (asked.classes, asked.encoder_id, asked.class_embeddings) {
        (classes, None, None) => {
            Sought::Words { prompts: classes.unwrap_or_default(), negatives: Some(Vec::new()) }
        }
        (None, encoder_id, embeddings) => Sought::Embeddings {
            encoder_id: encoder_id.unwrap_or_default(),
            prompts: embeddings.unwrap_or_default(),
            negatives: Vec::new(),
        },
        _ => return Err(Error::invalid("classes", "has names and embeddings; send either").into()),
    };
    let points = asked.points_m.len();
    let question = ClassifyQuestion {
        map_id,
        min_epoch: asked.min_epoch.unwrap_or_default(),
        max_age: max_age(asked.max_age_ms),
        ..ClassifyQuestion::new(asked.points_m, classes)
    };
    let reply = edge.service()?.classify(question, Call::HttpClassify).await?;
    let answer = ClassifyAnswer {
        class: reply.class,
        score: reply.score,
        encoder_id: reply.encoder_id,
        epoch: reply.epoch,
        newest_stamp_ns: reply.newest_stamp_ns,
        server_us: reply.spent.as_micros() as u64,
    };
    write(answer, points * CLASS_BYTES, share).await
}

/// Which encoders the server and a map have
#[utoipa::path(get, path = "/v1/maps/{map}/encoders", tag = "language",
    params(openapi::MapPath),
    responses((status = 200, description = "Encoders.", body = EncodersAnswer), MapRefusals))]
pub(super) async fn encoders(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
) -> Result<Response, Refusal> {
    let started = Instant::now();
    let encoders = edge.service()?.encoders(&map_id)?;
    let encoder = |contract: Contract| Encoder {
        encoder_id: contract.encoder_id.to_string(),
        dimension: contract.dimension,
    };
    json(&EncodersAnswer {
        server: encoders.server.map(encoder),
        map: encoders.map.map(encoder),
        epoch: encoders.epoch,
        newest_stamp_ns: encoders.newest_stamp_ns,
        server_us: started.elapsed().as_micros() as u64,
    })
}

/// A question in JSON, to a map that is there.
async fn read<T: DeserializeOwned + Send + 'static>(
    edge: &Edge,
    map_id: &str,
    request: Request,
    most: Most,
) -> Result<(T, Share), Refusal> {
    // Before the body comes: there may be much of it.
    edge.service()?.map_detail(map_id)?;
    Media::json_body(request.headers())?;
    let received = receive::<u8>(request.into_body(), most, &edge.limits, &edge.memory).await?;
    let Received { values, bytes, share } = received;
    Ok((off_thread(bytes, move || parse(&values)).await?, share))
}

fn question(
    map_id: String,
    sought: Sought,
    (region, min_score, top_k, places): (Option<Region>, Option<f32>, Option<u64>, Option<bool>),
    (min_epoch, max_age_ms): (Option<u64>, Option<u64>),
) -> Result<FindQuestion, Refusal> {
    check_integer("min_epoch", min_epoch)?;
    check_integer("max_age_ms", max_age_ms)?;
    Ok(FindQuestion {
        map_id,
        region: region.map(|Region { min, max }| Aabb { min, max }),
        min_score,
        top_k: top_k.unwrap_or_default() as usize,
        places: places.unwrap_or_default(),
        min_epoch: min_epoch.unwrap_or_default(),
        max_age: max_age(max_age_ms),
        ..FindQuestion::new(sought)
    })
}

fn max_age(ms: Option<u64>) -> Option<Duration> {
    ms.filter(|ms| *ms > 0).map(Duration::from_millis)
}

async fn answer(
    edge: &Edge,
    question: FindQuestion,
    call: Call,
    mut share: Share,
) -> Result<Response, Refusal> {
    let places = question.places;
    let reply = edge.service()?.find(question, call).await?;
    let bytes = reply.findings.places.points.len() * PLACE_BYTES;
    share.grow_to(bytes)?;
    write(TextAnswer::new(reply, places), bytes, share).await
}

async fn write(
    answer: impl Serialize + Send + 'static,
    bytes: usize,
    share: Share,
) -> Result<Response, Refusal> {
    let body = off_thread(bytes, move || {
        serde_json::to_vec(&answer)
            .map_err(|e| Error::Internal(format!("an answer did not become JSON: {e}")).into())
    });
    let body = Body::new(Parts::new(vec![Bytes::from(body.await?)], share));
    Ok(([(header::CONTENT_TYPE, JSON)], body).into_response())
}
