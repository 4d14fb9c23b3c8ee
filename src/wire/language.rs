//! `language.proto`: questions in words or embeddings, and their answers.

use std::time::Duration;

use glam::{DQuat, DVec3, Quat, Vec3};

use super::geometry::{pose_to_wire, required};
use super::v1;
use crate::error::{Error, Result};
use crate::frame::Contract;
use crate::geometry::{Aabb, Pose};
use crate::map::{Findings, Match, OrientedBox, Places};
use crate::service::{
    ClassifyQuestion, ClassifyReply, Encoders, FindQuestion, FindReply, Sought, points_of,
};

/// What a question about points or for an image compares places with. `of` goes before the names of
/// fields, as in `text.`.
impl TryFrom<v1::Text> for Sought {
    type Error = Error;

    fn try_from(text: v1::Text) -> Result<Self> {
        let v1::Text { prompts, negatives, no_negatives, encoder_id, .. } = text;
        let has_words = !prompts.is_empty() || !negatives.is_empty() || no_negatives;
        let has_numbers = !encoder_id.is_empty() || !text.prompt_embeddings.is_empty();
        if has_numbers && has_words {
            let problem = "has words and embeddings; send either";
            return Err(Error::invalid("text", problem));
        }
        Ok(if has_numbers {
            Self::Embeddings {
                encoder_id,
                prompts: values(text.prompt_embeddings),
                negatives: values(text.negative_embeddings),
            }
        } else {
            let negatives = negatives_from_wire("text.", negatives, no_negatives)?;
            Self::Words { prompts, negatives }
        })
    }
}

/// The message of what is sought.
pub(super) fn text_to_wire(sought: &Sought) -> v1::Text {
    match sought {
        Sought::Words { prompts, negatives } => v1::Text {
            prompts: prompts.clone(),
            no_negatives: negatives.as_ref().is_some_and(Vec::is_empty),
            negatives: negatives.clone().unwrap_or_default(),
            ..v1::Text::default()
        },
        Sought::Embeddings { encoder_id, prompts, negatives } => v1::Text {
            encoder_id: encoder_id.clone(),
            prompt_embeddings: embeddings(prompts),
            negative_embeddings: embeddings(negatives),
            ..v1::Text::default()
        },
    }
}

fn negatives_from_wire(
    of: &str,
    negatives: Vec<String>,
    none: bool,
) -> Result<Option<Vec<String>>> {
    match (negatives.is_empty(), none) {
        (true, true) => Ok(Some(negatives)),
        (true, false) => Ok(None),
        (false, false) => Ok(Some(negatives)),
        (false, true) => {
            let problem = format!("contradicts {of}negatives");
            Err(Error::invalid(format!("{of}no_negatives"), problem))
        }
    }
}

fn values(embeddings: Vec<v1::Embedding>) -> Vec<Vec<f32>> {
    embeddings.into_iter().map(|embedding| embedding.values).collect()
}

fn embeddings(values: &[Vec<f32>]) -> Vec<v1::Embedding> {
    values.iter().map(|values| v1::Embedding { values: values.clone() }).collect()
}

/// Shape is checked here, as it is of the message; the rest where every transport's questions are.
impl TryFrom<v1::QueryTextRequest> for FindQuestion {
    type Error = Error;

    fn try_from(message: v1::QueryTextRequest) -> Result<Self> {
        let negatives = negatives_from_wire("", message.negatives, message.no_negatives)?;
        Ok(Self {
            sought: Sought::Words { prompts: message.prompts, negatives },
            region: region_from_wire(message.region)?,
            min_score: message.min_score,
            top_k: message.top_k as usize,
            places: message.places,
            map_id: message.map_id,
            min_epoch: message.min_epoch,
            max_age: max_age_from_wire(message.max_age_ms),
        })
    }
}

impl TryFrom<v1::QueryEmbeddingRequest> for FindQuestion {
    type Error = Error;

    fn try_from(message: v1::QueryEmbeddingRequest) -> Result<Self> {
        Ok(Self {
            sought: Sought::Embeddings {
                encoder_id: message.encoder_id,
                prompts: values(message.prompts),
                negatives: values(message.negatives),
            },
            region: region_from_wire(message.region)?,
            min_score: message.min_score,
            top_k: message.top_k as usize,
            places: message.places,
            map_id: message.map_id,
            min_epoch: message.min_epoch,
            max_age: max_age_from_wire(message.max_age_ms),
        })
    }
}

/// The message of a question for things, by what it looks for.
pub enum FindRequest {
    Text(v1::QueryTextRequest),
    Embedding(v1::QueryEmbeddingRequest),
}

/// The message of a question.
pub fn find_question_to_wire(question: &FindQuestion) -> FindRequest {
    let (map_id, min_epoch) = (question.map_id.clone(), question.min_epoch);
    let (region, min_score) = (question.region.as_ref().map(region_to_wire), question.min_score);
    let (top_k, places) = (question.top_k as u32, question.places);
    let max_age_ms = max_age_to_wire(question.max_age);
    match &question.sought {
        Sought::Words { prompts, negatives } => FindRequest::Text(v1::QueryTextRequest {
            map_id,
            prompts: prompts.clone(),
            no_negatives: negatives.as_ref().is_some_and(Vec::is_empty),
            negatives: negatives.clone().unwrap_or_default(),
            region,
            min_score,
            top_k,
            min_epoch,
            max_age_ms,
            places,
        }),
        Sought::Embeddings { encoder_id, prompts, negatives } => {
            FindRequest::Embedding(v1::QueryEmbeddingRequest {
                map_id,
                encoder_id: encoder_id.clone(),
                prompts: embeddings(prompts),
                negatives: embeddings(negatives),
                region,
                min_score,
                top_k,
                min_epoch,
                max_age_ms,
                places,
            })
        }
    }
}

fn max_age_from_wire(ms: u64) -> Option<Duration> {
    (ms > 0).then(|| Duration::from_millis(ms))
}

/// At least 1: a limit of 0 would read as none.
fn max_age_to_wire(age: Option<Duration>) -> u64 {
    age.map_or(0, |age| (age.as_millis() as u64).max(1))
}

fn region_from_wire(region: Option<v1::Aabb>) -> Result<Option<Aabb>> {
    let Some(v1::Aabb { min, max }) = region else { return Ok(None) };
    let corner = |p: v1::Vector3| DVec3::new(p.x, p.y, p.z).as_vec3();
    let min = corner(required("region.min", min)?);
    let max = corner(required("region.max", max)?);
    Ok(Some(Aabb { min, max }))
}

/// Unlike a map's bounds, a region may be wrong: what is wrong with it is for the server to say.
fn region_to_wire(region: &Aabb) -> v1::Aabb {
    v1::Aabb { min: Some(vector_to_wire(region.min)), max: Some(vector_to_wire(region.max)) }
}

fn vector_to_wire(p: Vec3) -> v1::Vector3 {
    v1::Vector3 { x: f64::from(p.x), y: f64::from(p.y), z: f64::from(p.z) }
}

fn vector_from_wire(p: Option<v1::Vector3>) -> Vec3 {
    let p = p.unwrap_or_default();
    DVec3::new(p.x, p.y, p.z).as_vec3()
}

/// The message of an answer.
pub fn find_reply_to_wire(reply: FindReply) -> v1::QueryTextReply {
    let Findings { matches, places } = reply.findings;
    v1::QueryTextReply {
        matches: matches.iter().map(match_to_wire).collect(),
        places_m: bytemuck::allocation::cast_vec(places.points),
        place_score: places.scores,
        encoder_id: reply.encoder_id,
        epoch: reply.epoch,
        newest_stamp_ns: reply.newest_stamp_ns,
        server_us: reply.spent.as_micros() as u64,
    }
}

fn match_to_wire(found: &Match) -> v1::Match {
    let OrientedBox { center, rotation: q, half_size } = found.obb;
    let [x, y, z, w] = q.to_array().map(f64::from);
    v1::Match {
        id: found.id,
        score: found.score,
        centroid: Some(vector_to_wire(found.centroid)),
        obb: Some(v1::OrientedBox {
            center: Some(vector_to_wire(center)),
            rotation: Some(v1::Quaternion { x, y, z, w }),
            half_size: Some(vector_to_wire(half_size)),
        }),
        extent: Some(vector_to_wire(found.extent)),
        voxel_count: found.voxels,
        best_view: found.best_view.as_ref().map(pose_to_wire),
    }
}

impl From<v1::QueryTextReply> for FindReply {
    fn from(message: v1::QueryTextReply) -> Self {
        let points = message.places_m.chunks_exact(3).map(Vec3::from_slice).collect();
        Self {
            findings: Findings {
                matches: message.matches.into_iter().map(match_from_wire).collect(),
                places: Places { points, scores: message.place_score },
            },
            encoder_id: message.encoder_id,
            epoch: message.epoch,
            newest_stamp_ns: message.newest_stamp_ns,
            spent: Duration::from_micros(message.server_us),
        }
    }
}

fn match_from_wire(found: v1::Match) -> Match {
    let rotation = |q: Option<v1::Quaternion>| {
        let q = q.unwrap_or(v1::Quaternion { w: 1.0, ..v1::Quaternion::default() });
        DQuat::from_xyzw(q.x, q.y, q.z, q.w)
    };
    let obb = found.obb.unwrap_or_default();
    let turn: Quat = rotation(obb.rotation).as_quat();
    Match {
        id: found.id,
        score: found.score,
        centroid: vector_from_wire(found.centroid),
        obb: OrientedBox {
            center: vector_from_wire(obb.center),
            rotation: turn,
            half_size: vector_from_wire(obb.half_size),
        },
        extent: vector_from_wire(found.extent),
        voxels: found.voxel_count,
        best_view: found.best_view.map(|pose| {
            let t = pose.translation.unwrap_or_default();
            Pose { rotation: rotation(pose.rotation), translation: DVec3::new(t.x, t.y, t.z) }
        }),
    }
}

impl TryFrom<v1::ClassifyRequest> for ClassifyQuestion {
    type Error = Error;

    fn try_from(message: v1::ClassifyRequest) -> Result<Self> {
        let has_numbers = !message.encoder_id.is_empty() || !message.class_embeddings.is_empty();
        if has_numbers && !message.classes.is_empty() {
            return Err(Error::invalid("classes", "has names and embeddings; send either"));
        }
        let classes = if has_numbers {
            Sought::Embeddings {
                encoder_id: message.encoder_id,
                prompts: values(message.class_embeddings),
                negatives: Vec::new(),
            }
        } else {
            Sought::Words { prompts: message.classes, negatives: Some(Vec::new()) }
        };
        Ok(Self {
            points: points_of(&message.points_m)?,
            classes,
            map_id: message.map_id,
            min_epoch: message.min_epoch,
            max_age: max_age_from_wire(message.max_age_ms),
        })
    }
}

/// The message of a question for classes.
pub fn classify_question_to_wire(question: &ClassifyQuestion) -> v1::ClassifyRequest {
    let mut message = v1::ClassifyRequest {
        map_id: question.map_id.clone(),
        points_m: bytemuck::cast_slice(&question.points).to_vec(),
        min_epoch: question.min_epoch,
        max_age_ms: max_age_to_wire(question.max_age),
        ..v1::ClassifyRequest::default()
    };
    match &question.classes {
        Sought::Words { prompts, .. } => message.classes = prompts.clone(),
        Sought::Embeddings { encoder_id, prompts, .. } => {
            message.encoder_id = encoder_id.clone();
            message.class_embeddings = embeddings(prompts);
        }
    }
    message
}

/// The message of an answer.
pub fn classify_reply_to_wire(reply: ClassifyReply) -> v1::ClassifyReply {
    v1::ClassifyReply {
        class: reply.class,
        score: reply.score,
        encoder_id: reply.encoder_id,
        epoch: reply.epoch,
        newest_stamp_ns: reply.newest_stamp_ns,
        server_us: reply.spent.as_micros() as u64,
    }
}

impl From<v1::ClassifyReply> for ClassifyReply {
    fn from(message: v1::ClassifyReply) -> Self {
        Self {
            class: message.class,
            score: message.score,
            encoder_id: message.encoder_id,
            epoch: message.epoch,
            newest_stamp_ns: message.newest_stamp_ns,
            spent: Duration::from_micros(message.server_us),
        }
    }
}

/// The message of which encoders there are.
pub fn encoders_to_wire(encoders: Encoders, spent: Duration) -> v1::ListEncodersReply {
    let encoder = |contract: Contract| v1::Encoder {
        encoder_id: contract.encoder_id.to_string(),
        dimension: contract.dimension as u32,
    };
    v1::ListEncodersReply {
        server: encoders.server.map(encoder),
        map: encoders.map.map(encoder),
        epoch: encoders.epoch,
        newest_stamp_ns: encoders.newest_stamp_ns,
        server_us: spent.as_micros() as u64,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use prost::Message;

    use super::*;

    fn texts() -> impl Strategy<Value = Vec<String>> {
        prop::collection::vec("[a-z ]{1,9}", 1..4)
    }

    fn numbers(least: usize) -> impl Strategy<Value = Vec<Vec<f32>>> {
        prop::collection::vec(prop::collection::vec(-1e6f32..1e6, 0..5), least..4)
    }

    fn sought() -> impl Strategy<Value = Sought> {
        prop_oneof![
            (texts(), prop::option::of(prop::collection::vec("[a-z]{1,9}", 0..4)))
                .prop_map(|(prompts, negatives)| Sought::Words { prompts, negatives }),
            ("[a-z]{1,9}", numbers(1), numbers(0)).prop_map(|(encoder_id, prompts, negatives)| {
                Sought::Embeddings { encoder_id, prompts, negatives }
            }),
        ]
    }

    prop_compose! {
        fn questions()(
            sought in sought(),
            region in prop::option::of(prop::array::uniform6(-1e6f32..1e6)),
            min_score in prop::option::of(-2f32..2.0),
            (top_k, places) in (0usize..2000, any::<bool>()),
            (min_epoch, max_age_ms) in (any::<u64>(), prop::option::of(1..u64::MAX)),
        ) -> FindQuestion {
            FindQuestion {
                map_id: "default".into(),
                sought,
                region: region.map(|[a, b, c, d, e, f]| Aabb {
                    min: Vec3::new(a, b, c), max: Vec3::new(d, e, f),
                }),
                min_score,
                top_k,
                places,
                min_epoch,
                max_age: max_age_ms.map(Duration::from_millis),
            }
        }
    }

    fn received<M: Message + Default>(message: &M) -> M {
        M::decode(message.encode_to_vec().as_slice()).expect("our own")
    }

    proptest! {
        #[test]
        fn questions_come_back_as_they_were(question in questions(), points in prop::collection::vec(
            prop::array::uniform3(-1e6f32..1e6), 0..9)) {
            let back = match find_question_to_wire(&question) {
                FindRequest::Text(message) => FindQuestion::try_from(received(&message)),
                FindRequest::Embedding(message) => FindQuestion::try_from(received(&message)),
            };
            prop_assert_eq!(back.expect("good"), question.clone());
            let text = received(&text_to_wire(&question.sought));
            prop_assert_eq!(Sought::try_from(text).expect("good"), question.sought.clone());

            let points = points.into_iter().map(Vec3::from).collect();
            let classes = match question.sought {
                Sought::Words { prompts, .. } => {
                    Sought::Words { prompts, negatives: Some(Vec::new()) }
                }
                Sought::Embeddings { encoder_id, prompts, .. } => {
                    Sought::Embeddings { encoder_id, prompts, negatives: Vec::new() }
                }
            };
            let asked = ClassifyQuestion { min_epoch: 3, ..ClassifyQuestion::new(points, classes) };
            let message = received(&classify_question_to_wire(&asked));
            prop_assert_eq!(ClassifyQuestion::try_from(message).expect("good"), asked);
        }

        #[test]
        fn noise_does_no_harm(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            if let Ok(message) = v1::QueryTextRequest::decode(bytes.as_slice()) {
                let _ = FindQuestion::try_from(message);
            }
            if let Ok(message) = v1::QueryEmbeddingRequest::decode(bytes.as_slice()) {
                let _ = FindQuestion::try_from(message);
            }
            if let Ok(message) = v1::ClassifyRequest::decode(bytes.as_slice()) {
                let _ = ClassifyQuestion::try_from(message);
            }
        }
    }

    #[test]
    fn answers_come_back_as_they_were() {
        let found = Match {
            id: 3,
            score: 0.75,
            centroid: Vec3::new(1.0, 2.0, 0.1),
            obb: OrientedBox {
                center: Vec3::X,
                rotation: Quat::from_rotation_z(0.5),
                half_size: Vec3::new(0.3, 0.2, 0.1),
            },
            extent: Vec3::ONE,
            voxels: 77,
            best_view: Some(Pose {
                rotation: DQuat::from_rotation_y(0.3),
                translation: DVec3::new(4.0, 5.0, 6.0),
            }),
        };
        let unseen = Match { id: 4, best_view: None, ..found.clone() };
        let reply = FindReply {
            findings: Findings {
                matches: vec![found, unseen],
                places: Places { points: vec![Vec3::X, Vec3::Z], scores: vec![0.25, -0.5] },
            },
            encoder_id: "clip".into(),
            epoch: 4,
            newest_stamp_ns: -5,
            spent: Duration::from_micros(6),
        };
        let back = FindReply::from(received(&find_reply_to_wire(reply.clone())));
        assert_eq!(back, reply);
        let reply = ClassifyReply {
            class: vec![2, -1],
            score: vec![0.5, f32::NAN],
            encoder_id: "clip".into(),
            epoch: 4,
            newest_stamp_ns: 5,
            spent: Duration::from_micros(6),
        };
        let back = ClassifyReply::from(received(&classify_reply_to_wire(reply.clone())));
        assert_eq!((&back.class, back.score[0], back.epoch), (&reply.class, 0.5, 4));
        assert_eq!(back.score[1].to_bits(), f32::NAN.to_bits());
    }

    #[test]
    fn what_contradicts_itself_is_refused_by_name() {
        let text = v1::Text { prompts: vec!["chair".into()], ..v1::Text::default() };
        let both = v1::Text { encoder_id: "clip".into(), ..text.clone() };
        assert_eq!(Sought::try_from(both).expect_err("both").field(), Some("text"));
        let negatives = vec!["wall".to_owned()];
        let none = v1::Text { negatives: negatives.clone(), no_negatives: true, ..text };
        let error = Sought::try_from(none).expect_err("which?");
        assert_eq!(error.field(), Some("text.no_negatives"));
        let find = v1::QueryTextRequest { negatives, no_negatives: true, ..Default::default() };
        let error = FindQuestion::try_from(find).expect_err("which?");
        assert_eq!(error.field(), Some("no_negatives"));
        let region = Some(v1::Aabb { min: Some(v1::Vector3::default()), max: None });
        let find = v1::QueryTextRequest { region, ..Default::default() };
        assert_eq!(FindQuestion::try_from(find).expect_err("half").field(), Some("region.max"));
        let classify = v1::ClassifyRequest {
            classes: vec!["chair".into()],
            encoder_id: "clip".into(),
            ..Default::default()
        };
        let error = ClassifyQuestion::try_from(classify).expect_err("both");
        assert_eq!(error.field(), Some("classes"));
    }
}
