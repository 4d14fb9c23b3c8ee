//! Grids and slices.

use std::time::Duration;

use glam::{UVec3, Vec2};

use super::{fields_or, max_age_ms, place_from_wire, place_to_wire, region_from_wire, terms};
use crate::error::{Error, Result};
use crate::map::{Costs, Fields, GridShape, LevelShape};
use crate::service::{
    Answered, Grid, GridColumns, GridQuestion, GridReply, Level, NumberFormat, SliceQuestion,
    SliceReply, Terms, Unknown,
};
use crate::wire::geometry::{aabb_to_wire, required};
use crate::wire::query::{fields_to_wire, policy_from_wire, policy_to_wire};
use crate::wire::v1;

impl TryFrom<v1::GetGridRequest> for GridQuestion {
    type Error = Error;

    fn try_from(message: v1::GetGridRequest) -> Result<Self> {
        let usual = Fields { state: true, ..Fields::DISTANCE };
        Ok(Self {
            region: region_from_wire(required("region", message.region)?)?,
            voxel_m: message.voxel_m,
            fields: fields_or(&message.fields, usual)?,
            format: match v1::NumberFormat::try_from(message.format) {
                Ok(v1::NumberFormat::Unspecified | v1::NumberFormat::F32) => NumberFormat::F32,
                Ok(v1::NumberFormat::F16) => NumberFormat::F16,
                Err(_) => {
                    let problem = format!("{} is none of F32, F16", message.format);
                    return Err(Error::invalid("format", problem));
                }
            },
            terms: terms!(message),
        })
    }
}

fn format_to_wire(format: NumberFormat) -> v1::NumberFormat {
    match format {
        NumberFormat::F32 => v1::NumberFormat::F32,
        NumberFormat::F16 => v1::NumberFormat::F16,
    }
}

/// The message of a question.
pub fn grid_question_to_wire(question: &GridQuestion) -> v1::GetGridRequest {
    let terms = &question.terms;
    v1::GetGridRequest {
        map_id: terms.map_id.clone(),
        region: aabb_to_wire(&question.region),
        voxel_m: question.voxel_m,
        fields: fields_to_wire(question.fields),
        format: format_to_wire(question.format).into(),
        min_epoch: terms.min_epoch,
        max_age_ms: max_age_ms(terms),
        unknown_policy: policy_to_wire(terms.unknown.policy).into(),
        unknown_distance_m: terms.unknown.distance_m,
        frame_id: terms.frame_id.clone(),
    }
}

/// The message of an answer.
pub fn grid_reply_to_wire(reply: GridReply) -> v1::GetGridReply {
    let Grid { shape, format, columns } = reply.answer;
    let GridColumns { distance, gradient, occupancy, color, state } = columns;
    let columns = [
        (v1::PointField::Distance, 1, distance),
        (v1::PointField::Gradient, 3, gradient),
        (v1::PointField::Occupancy, 1, occupancy),
        (v1::PointField::Color, 3, color),
        (v1::PointField::State, 1, state),
    ];
    let column = |(field, width, data): (v1::PointField, u32, Vec<u8>)| v1::GridColumn {
        field: field.into(),
        format: format_to_wire(format).into(),
        width,
        data,
    };
    v1::GetGridReply {
        origin_m: Some(place_to_wire(shape.origin)),
        voxel_m: shape.voxel_m,
        size: shape.size.to_array().to_vec(),
        stride: shape.stride().to_array().to_vec(),
        columns: columns.into_iter().filter(|(.., data)| !data.is_empty()).map(column).collect(),
        epoch: reply.epoch,
        newest_stamp_ns: reply.newest_stamp_ns,
        server_us: reply.spent.as_micros() as u64,
    }
}

/// The answer of a message; an error if it is none.
pub fn grid_reply_from_wire(message: v1::GetGridReply) -> Result<GridReply> {
    let [x, y, z] = message.size[..] else {
        return Err(Error::corrupt("the server's answer", "size needs three numbers"));
    };
    let shape = GridShape {
        origin: place_from_wire(message.origin_m),
        voxel_m: message.voxel_m,
        size: UVec3::new(x, y, z),
    };
    let (mut columns, mut format) = (GridColumns::default(), NumberFormat::F32);
    for column in message.columns {
        if column.format() == v1::NumberFormat::F16 {
            format = NumberFormat::F16;
        }
        match column.field() {
            v1::PointField::Distance => columns.distance = column.data,
            v1::PointField::Gradient => columns.gradient = column.data,
            v1::PointField::Occupancy => columns.occupancy = column.data,
            v1::PointField::Color => columns.color = column.data,
            v1::PointField::State => columns.state = column.data,
            v1::PointField::Unspecified | v1::PointField::TextScore => {}
        }
    }
    Ok(Answered {
        answer: Grid { shape, format, columns },
        epoch: message.epoch,
        newest_stamp_ns: message.newest_stamp_ns,
        spent: Duration::from_micros(message.server_us),
    })
}

impl TryFrom<v1::GetSliceRequest> for SliceQuestion {
    type Error = Error;

    fn try_from(message: v1::GetSliceRequest) -> Result<Self> {
        let costs = |c: v1::SliceCosts| Costs {
            robot_radius_m: c.robot_radius_m,
            inflation_m: c.inflation_m,
        };
        Ok(Self {
            z_m: message.z_m,
            z_max_m: message.z_max_m,
            resolution_m: message.resolution_m,
            region: message.region.map(region_from_wire).transpose()?,
            costs: message.costs.map(costs),
            terms: terms!(message),
        })
    }
}

/// The message of a question.
pub fn slice_question_to_wire(question: &SliceQuestion) -> v1::GetSliceRequest {
    let terms = &question.terms;
    v1::GetSliceRequest {
        map_id: terms.map_id.clone(),
        z_m: question.z_m,
        z_max_m: question.z_max_m,
        resolution_m: question.resolution_m,
        region: question.region.map(|region| v1::Aabb {
            min: Some(place_to_wire(region.min)),
            max: Some(place_to_wire(region.max)),
        }),
        costs: question.costs.map(|c| v1::SliceCosts {
            robot_radius_m: c.robot_radius_m,
            inflation_m: c.inflation_m,
        }),
        min_epoch: terms.min_epoch,
        max_age_ms: max_age_ms(terms),
        unknown_policy: policy_to_wire(terms.unknown.policy).into(),
        unknown_distance_m: terms.unknown.distance_m,
        frame_id: terms.frame_id.clone(),
    }
}

/// The message of an answer.
pub fn slice_reply_to_wire(reply: SliceReply) -> v1::GetSliceReply {
    let Level { shape, distance_m, cost } = reply.answer;
    let z = shape.heights.first().copied().unwrap_or_default();
    v1::GetSliceReply {
        origin_m: Some(place_to_wire(shape.origin.extend(z))),
        resolution_m: shape.resolution_m,
        width: shape.width,
        height: shape.height,
        distance_m,
        cost: bytemuck::cast_vec(cost),
        epoch: reply.epoch,
        newest_stamp_ns: reply.newest_stamp_ns,
        server_us: reply.spent.as_micros() as u64,
    }
}

impl From<v1::GetSliceReply> for SliceReply {
    fn from(message: v1::GetSliceReply) -> Self {
        let origin = place_from_wire(message.origin_m);
        let shape = LevelShape {
            origin: Vec2::new(origin.x, origin.y),
            resolution_m: message.resolution_m,
            width: message.width,
            height: message.height,
            heights: vec![origin.z],
        };
        let cost = bytemuck::cast_vec(message.cost);
        Self {
            answer: Level { shape, distance_m: message.distance_m, cost },
            epoch: message.epoch,
            newest_stamp_ns: message.newest_stamp_ns,
            spent: Duration::from_micros(message.server_us),
        }
    }
}
