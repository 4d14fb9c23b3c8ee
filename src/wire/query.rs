//! `query.proto`: questions about points and their answers.

use std::time::Duration;

use glam::Vec3;

use super::geometry::required;
use super::language::text_to_wire;
use super::status::{Codes, error_from_status};
use super::v1;
use crate::error::{Error, Result};
use crate::map::{Fields, PointAnswers};
use crate::service::{PointsQuestion, PointsReply, Sought, Unknown, UnknownPolicy, points_of};

/// Shape and names are checked here, as they are of the message; the rest where every transport's
/// questions are.
impl TryFrom<v1::QueryPointsRequest> for PointsQuestion {
    type Error = Error;

    fn try_from(message: v1::QueryPointsRequest) -> Result<Self> {
        let text = message.text.map(Sought::try_from).transpose()?;
        let mut fields = fields_from_wire(&message.fields)?;
        fields.text_score |= text.is_some();
        Ok(Self {
            points: points_of(&message.points_m)?,
            fields,
            text,
            unknown: Unknown {
                policy: policy_from_wire(message.unknown_policy)?,
                distance_m: message.unknown_distance_m,
            },
            map_id: message.map_id,
            frame_id: message.frame_id,
            min_epoch: message.min_epoch,
            max_age: (message.max_age_ms > 0).then(|| Duration::from_millis(message.max_age_ms)),
        })
    }
}

/// The message of a question.
pub fn points_question_to_wire(question: &PointsQuestion) -> v1::QueryPointsRequest {
    let fields = question.fields;
    let named = [
        (fields.distance, v1::PointField::Distance),
        (fields.gradient, v1::PointField::Gradient),
        (fields.occupancy, v1::PointField::Occupancy),
        (fields.state, v1::PointField::State),
        (fields.color, v1::PointField::Color),
        (fields.text_score, v1::PointField::TextScore),
    ];
    v1::QueryPointsRequest {
        map_id: question.map_id.clone(),
        points_m: flat(&question.points),
        fields: named.iter().filter(|(asked, _)| *asked).map(|(_, f)| (*f).into()).collect(),
        min_epoch: question.min_epoch,
        // At least 1: a limit of 0 would read as none.
        max_age_ms: question.max_age.map_or(0, |age| (age.as_millis() as u64).max(1)),
        unknown_policy: policy_to_wire(question.unknown.policy).into(),
        unknown_distance_m: question.unknown.distance_m,
        frame_id: question.frame_id.clone(),
        text: question.text.as_ref().map(text_to_wire),
    }
}

fn policy_from_wire(policy: i32) -> Result<UnknownPolicy> {
    match v1::UnknownPolicy::try_from(policy) {
        Ok(v1::UnknownPolicy::Report) => Ok(UnknownPolicy::Report),
        Ok(v1::UnknownPolicy::Free) => Ok(UnknownPolicy::Free),
        Ok(v1::UnknownPolicy::Occupied) => Ok(UnknownPolicy::Occupied),
        Err(_) => Err(Error::invalid(
            "unknown_policy",
            format!("{policy} is none of REPORT, FREE, OCCUPIED"),
        )),
    }
}

fn policy_to_wire(policy: UnknownPolicy) -> v1::UnknownPolicy {
    match policy {
        UnknownPolicy::Report => v1::UnknownPolicy::Report,
        UnknownPolicy::Free => v1::UnknownPolicy::Free,
        UnknownPolicy::Occupied => v1::UnknownPolicy::Occupied,
    }
}

fn fields_from_wire(fields: &[i32]) -> Result<Fields> {
    if fields.is_empty() {
        return Ok(Fields::ALL);
    }
    let mut asked = Fields::NONE;
    for (index, field) in fields.iter().enumerate() {
        match v1::PointField::try_from(*field) {
            Ok(v1::PointField::Distance) => asked.distance = true,
            Ok(v1::PointField::Gradient) => asked.gradient = true,
            Ok(v1::PointField::Occupancy) => asked.occupancy = true,
            Ok(v1::PointField::State) => asked.state = true,
            Ok(v1::PointField::Color) => asked.color = true,
            Ok(v1::PointField::TextScore) => asked.text_score = true,
            Ok(v1::PointField::Unspecified) | Err(_) => {
                let all = "DISTANCE, GRADIENT, OCCUPANCY, STATE, COLOR, TEXT_SCORE";
                let problem = format!("{field} is none of {all}");
                return Err(Error::invalid(format!("fields[{index}]"), problem));
            }
        }
    }
    Ok(asked)
}

/// The message of an answer.
pub fn points_reply_to_wire(reply: PointsReply) -> v1::QueryPointsReply {
    v1::QueryPointsReply {
        gradient: flat(&reply.answers.gradient),
        color: flat(&reply.answers.color),
        distance_m: reply.answers.distance,
        occupancy: reply.answers.occupancy,
        state: reply.answers.state,
        text_score: reply.answers.text_score,
        epoch: reply.epoch,
        newest_stamp_ns: reply.newest_stamp_ns,
        server_us: reply.spent.as_micros() as u64,
    }
}

impl From<v1::QueryPointsReply> for PointsReply {
    fn from(message: v1::QueryPointsReply) -> Self {
        Self {
            answers: PointAnswers {
                distance: message.distance_m,
                gradient: message.gradient.chunks_exact(3).map(Vec3::from_slice).collect(),
                occupancy: message.occupancy,
                state: message.state,
                color: message.color.chunks_exact(3).map(Vec3::from_slice).collect(),
                text_score: message.text_score,
            },
            epoch: message.epoch,
            newest_stamp_ns: message.newest_stamp_ns,
            spent: Duration::from_micros(message.server_us),
        }
    }
}

/// The message of a question in a stream.
pub fn stream_question_to_wire(id: u64, question: &PointsQuestion) -> v1::StreamQueryRequest {
    let question = v1::stream_query_request::Question::Points(points_question_to_wire(question));
    v1::StreamQueryRequest { id, question: Some(question) }
}

/// The message of what became of a question in a stream.
pub fn stream_reply_to_wire(id: u64, outcome: Result<PointsReply>) -> v1::StreamQueryReply {
    use v1::stream_query_reply::Answer;
    let answer = match outcome {
        Ok(reply) => Answer::Points(points_reply_to_wire(reply)),
        Err(error) => Answer::Error(refusal_to_wire(&error)),
    };
    v1::StreamQueryReply { id, answer: Some(answer) }
}

/// What became of a question in a stream, and its number.
pub fn stream_reply_from_wire(message: v1::StreamQueryReply) -> Result<(u64, Result<PointsReply>)> {
    use v1::stream_query_reply::Answer;
    let outcome = match required("answer", message.answer)? {
        Answer::Points(reply) => Ok(reply.into()),
        Answer::Error(error) => Err(refusal_from_wire(error)),
    };
    Ok((message.id, outcome))
}

/// Why a question has no answer, where there is no status to say it.
pub fn refusal_to_wire(error: &Error) -> v1::QueryError {
    v1::QueryError {
        code: i32::from(Codes::of(error.status()).grpc) as u32,
        field: error.field().unwrap_or_default().to_owned(),
        message: error.to_string(),
    }
}

/// What a client's caller sees of it.
pub fn refusal_from_wire(error: v1::QueryError) -> Error {
    let code = tonic::Code::from_i32(error.code as i32);
    error_from_status(&tonic::Status::new(code, error.message))
}

fn flat(vectors: &[Vec3]) -> Vec<f32> {
    bytemuck::cast_slice(vectors).to_vec()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use prost::Message;

    use super::*;

    prop_compose! {
        fn questions()(
            points in prop::collection::vec(prop::array::uniform3(-1e6f32..1e6), 0..40),
            [distance, gradient, occupancy, color, text_score] in any::<[bool; 5]>(),
            (min_epoch, max_age_ms) in (any::<u64>(), prop::option::of(1..u64::MAX)),
            policy in prop::sample::select(vec![
                UnknownPolicy::Report, UnknownPolicy::Free, UnknownPolicy::Occupied,
            ]),
            distance_m in prop::option::of(-1e6f32..1e6),
            frame_id in "[a-z]{0,9}",
        ) -> PointsQuestion {
            PointsQuestion {
                map_id: "default".into(),
                frame_id,
                points: points.into_iter().map(Vec3::from).collect(),
                // No field at all means every field, so one is always asked for.
                fields: Fields { distance, gradient, occupancy, state: true, color, text_score },
                text: text_score.then(|| Sought::words(&["somewhere to sit"])),
                min_epoch,
                max_age: max_age_ms.map(Duration::from_millis),
                unknown: Unknown { policy, distance_m },
            }
        }
    }

    proptest! {
        #[test]
        fn a_question_comes_back_as_it_was(question in questions()) {
            let bytes = points_question_to_wire(&question).encode_to_vec();
            let message = v1::QueryPointsRequest::decode(bytes.as_slice()).expect("our own");
            prop_assert_eq!(PointsQuestion::try_from(message).expect("good"), question);
        }

        #[test]
        fn an_answer_comes_back_bit_for_bit(
            rows in prop::collection::vec((any::<[f32; 9]>(), 0u8..3), 0..40),
            (epoch, newest_stamp_ns, us) in (any::<u64>(), any::<i64>(), any::<u32>()),
        ) {
            let reply = PointsReply {
                answers: PointAnswers {
                    distance: rows.iter().map(|(n, _)| n[0]).collect(),
                    gradient: rows.iter().map(|(n, _)| Vec3::from_slice(&n[1..4])).collect(),
                    occupancy: rows.iter().map(|(n, _)| n[4]).collect(),
                    state: rows.iter().map(|(_, state)| *state).collect(),
                    color: rows.iter().map(|(n, _)| Vec3::from_slice(&n[5..8])).collect(),
                    text_score: rows.iter().map(|(n, _)| n[8]).collect(),
                },
                epoch,
                newest_stamp_ns,
                spent: Duration::from_micros(us.into()),
            };
            let bytes = points_reply_to_wire(reply.clone()).encode_to_vec();
            let back = PointsReply::from(v1::QueryPointsReply::decode(bytes.as_slice()).expect("ours"));
            // NaN is an answer too: bits are compared.
            let bits = |a: &PointAnswers| {
                let (gradient, color) = (flat(&a.gradient), flat(&a.color));
                [&a.distance, &gradient, &a.occupancy, &color, &a.text_score].map(|c| c.iter().map(|n| n.to_bits()).collect::<Vec<_>>())
            };
            prop_assert_eq!(bits(&back.answers), bits(&reply.answers));
            prop_assert_eq!(&back.answers.state, &reply.answers.state);
            prop_assert_eq!((back.epoch, back.newest_stamp_ns, back.spent), (epoch, newest_stamp_ns, reply.spent));
        }

        #[test]
        fn noise_does_no_harm(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            if let Ok(message) = v1::QueryPointsRequest::decode(bytes.as_slice())
                && let numbers = message.points_m.len()
                && let Ok(question) = PointsQuestion::try_from(message)
            {
                prop_assert_eq!(question.points.len() * 3, numbers);
            }
        }
    }

    #[test]
    fn what_became_of_a_streamed_question_comes_back() {
        let error = Error::invalid("points_m[3].x", "NaN must be finite");
        let message = stream_reply_to_wire(7, Err(error));
        let Some(v1::stream_query_reply::Answer::Error(error)) = &message.answer else {
            panic!("{message:?}")
        };
        assert_eq!((error.code, error.field.as_str()), (3, "points_m[3].x"));
        let (id, outcome) = stream_reply_from_wire(message).expect("whole");
        let error = outcome.expect_err("refused").to_string();
        assert_eq!((id, error.as_str()), (7, "points_m[3].x: NaN must be finite"));
        assert!(stream_reply_from_wire(v1::StreamQueryReply::default()).is_err());
    }

    #[test]
    fn no_fields_mean_all_of_them() {
        assert_eq!(fields_from_wire(&[]).expect("fine"), Fields::ALL);
        let error = fields_from_wire(&[0]).expect_err("unspecified").to_string();
        assert!(error.starts_with("fields[0]: 0"), "{error}");
        let error = policy_from_wire(3).expect_err("no such policy").to_string();
        assert!(error.starts_with("unknown_policy: 3"), "{error}");
    }
}
