//! `query.proto`: questions about points and their answers.

use std::time::Duration;

use glam::Vec3;

use super::v1;
use crate::error::{Error, Result};
use crate::map::{Fields, PointAnswers};
use crate::service::PointsReply;

/// A checked question: whole, finite points and known columns. How many points are too many is for
/// the service to say.
#[derive(Debug, Clone, PartialEq)]
pub struct PointsQuestion {
    pub map_id: String,
    pub points: Vec<Vec3>,
    pub fields: Fields,
    pub min_epoch: u64,
}

impl TryFrom<v1::QueryPointsRequest> for PointsQuestion {
    type Error = Error;

    fn try_from(message: v1::QueryPointsRequest) -> Result<Self> {
        let numbers = &message.points_m;
        if !numbers.len().is_multiple_of(3) {
            return Err(Error::invalid(
                "points_m",
                format!("{} numbers are no whole points of x, y, z", numbers.len()),
            ));
        }
        if let Some(at) = numbers.iter().position(|n| !n.is_finite()) {
            let axis = ["x", "y", "z"][at % 3];
            return Err(Error::invalid(
                format!("points_m[{}].{axis}", at / 3),
                format!("{} must be finite", numbers[at]),
            ));
        }
        Ok(Self {
            fields: fields_from_wire(&message.fields)?,
            points: numbers.chunks_exact(3).map(Vec3::from_slice).collect(),
            map_id: message.map_id,
            min_epoch: message.min_epoch,
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
    ];
    v1::QueryPointsRequest {
        map_id: question.map_id.clone(),
        points_m: flat(&question.points),
        fields: named.iter().filter(|(asked, _)| *asked).map(|(_, f)| (*f).into()).collect(),
        min_epoch: question.min_epoch,
    }
}

fn fields_from_wire(fields: &[i32]) -> Result<Fields> {
    if fields.is_empty() {
        return Ok(Fields::ALL);
    }
    let mut asked = Fields { distance: false, gradient: false, occupancy: false, state: false };
    for (index, field) in fields.iter().enumerate() {
        match v1::PointField::try_from(*field) {
            Ok(v1::PointField::Distance) => asked.distance = true,
            Ok(v1::PointField::Gradient) => asked.gradient = true,
            Ok(v1::PointField::Occupancy) => asked.occupancy = true,
            Ok(v1::PointField::State) => asked.state = true,
            Ok(v1::PointField::Unspecified) | Err(_) => {
                return Err(Error::invalid(
                    format!("fields[{index}]"),
                    format!("{field} is none of DISTANCE, GRADIENT, OCCUPANCY, STATE"),
                ));
            }
        }
    }
    Ok(asked)
}

/// The message of an answer.
pub fn points_reply_to_wire(reply: PointsReply) -> v1::QueryPointsReply {
    v1::QueryPointsReply {
        gradient: flat(&reply.answers.gradient),
        distance_m: reply.answers.distance,
        occupancy: reply.answers.occupancy,
        state: reply.answers.state,
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
            },
            epoch: message.epoch,
            newest_stamp_ns: message.newest_stamp_ns,
            spent: Duration::from_micros(message.server_us),
        }
    }
}

fn flat(vectors: &[Vec3]) -> Vec<f32> {
    bytemuck::cast_slice(vectors).to_vec()
}
