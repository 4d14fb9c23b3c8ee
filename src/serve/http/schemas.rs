//! Schemas of what the types alone do not say: ranges, lengths, null.

use serde_json::{Value, json};
use utoipa::openapi::schema::{
    ArrayBuilder, ArrayItems, KnownFormat, SchemaFormat, SchemaType, Type,
};
use utoipa::openapi::{ObjectBuilder, Schema};

use super::options::MAX_INTEGER;
use crate::geometry::MAX_COORDINATE_M;
use crate::service::MAP_FRAME;

fn integer(types: &[Type]) -> ObjectBuilder {
    let types = [&[Type::Integer], types].concat();
    ObjectBuilder::new()
        .schema_type(SchemaType::from_iter(types))
        .format(Some(SchemaFormat::KnownFormat(KnownFormat::Int64)))
        .maximum(Some(MAX_INTEGER as usize))
}

pub(super) fn timeout() -> Schema {
    integer(&[]).minimum(Some(1)).into()
}

fn number(types: &[Type]) -> ObjectBuilder {
    let types = [&[Type::Number], types].concat();
    ObjectBuilder::new()
        .schema_type(SchemaType::from_iter(types))
        .format(Some(SchemaFormat::KnownFormat(KnownFormat::Float)))
}

fn list(of: impl Into<ArrayItems>) -> ArrayBuilder {
    ArrayBuilder::new().items(of)
}

fn three(of: ObjectBuilder) -> ArrayBuilder {
    list(of).min_items(Some(3)).max_items(Some(3))
}

/// x, y, z.
pub(super) fn triple() -> Schema {
    three(number(&[])).into()
}

/// Any number of x, y, z that a single float can hold.
pub(super) fn points() -> Schema {
    let bound = f64::from(f32::MAX);
    let points = list(three(number(&[]).minimum(Some(-bound)).maximum(Some(bound))));
    points.description(Some("[x, y, z] of each point, world metres.")).into()
}

/// The columns of an answer.
pub(super) fn distances() -> Schema {
    let text = "Signed distance to the nearest surface, m: positive outside, negative inside; null \
                where unknown.";
    list(number(&[Type::Null])).description(Some(text)).into()
}

pub(super) fn gradients() -> Schema {
    let text = "[x, y, z] of the gradient of the distance, towards increasing distance, world axes, \
                unitless; three nulls where unknown.";
    list(three(number(&[Type::Null]))).description(Some(text)).into()
}

pub(super) fn occupancies() -> Schema {
    let text = "Probability that the point is occupied; null where unknown.";
    list(number(&[Type::Null])).description(Some(text)).into()
}

pub(super) fn states() -> Schema {
    let state = ObjectBuilder::new().schema_type(SchemaType::new(Type::Integer));
    let text = "0 unknown: never observed, or outside of the map; 1 free; 2 occupied.";
    list(state.enum_values(Some([0, 1, 2]))).description(Some(text)).into()
}

fn frame_id(null: bool) -> ObjectBuilder {
    let types = if null { vec![Type::String, Type::Null] } else { vec![Type::String] };
    let mut names = vec![json!(""), json!(MAP_FRAME)];
    names.extend(null.then_some(Value::Null));
    ObjectBuilder::new()
        .schema_type(SchemaType::from_iter(types))
        .enum_values(Some(names))
        .description(Some("The frame of the points: \"map\", the world of the poses."))
}

fn min_epoch(null: &[Type]) -> ObjectBuilder {
    let text = "Fails with FAILED_PRECONDITION if the newest epoch is older; an INTEGRATED ack says \
                which epoch holds a frame.";
    integer(null).minimum(Some(0)).description(Some(text))
}

fn max_age(null: &[Type]) -> ObjectBuilder {
    let text = "Fails with FAILED_PRECONDITION if the newest frame of that epoch came to the server \
                longer ago than this, ms. 0: any age.";
    integer(null).minimum(Some(0)).description(Some(text))
}

fn unknown_distance(null: &[Type]) -> ObjectBuilder {
    let text = "The distance of unknown points under `free` (as it is) and `occupied` (negative), m. \
                Left out: as far as the map's distances reach. Refused under `report`.";
    // The least that a single float holds with all of its digits.
    let least = f64::from(f32::MIN_POSITIVE);
    number(null).minimum(Some(least)).maximum(Some(MAX_COORDINATE_M)).description(Some(text))
}

/// Options in a query string, where nothing is null.
pub(super) mod text {
    use super::Schema;

    pub(in super::super) fn frame_id() -> Schema {
        super::frame_id(false).into()
    }

    pub(in super::super) fn min_epoch() -> Schema {
        super::min_epoch(&[]).into()
    }

    pub(in super::super) fn max_age() -> Schema {
        super::max_age(&[]).into()
    }

    pub(in super::super) fn unknown_distance() -> Schema {
        super::unknown_distance(&[]).into()
    }
}

/// Options in JSON, where null is the same as leaving them out.
pub(super) mod body {
    use super::{Schema, Type};

    pub(in super::super) fn frame_id() -> Schema {
        super::frame_id(true).into()
    }

    pub(in super::super) fn min_epoch() -> Schema {
        super::min_epoch(&[Type::Null]).into()
    }

    pub(in super::super) fn max_age() -> Schema {
        super::max_age(&[Type::Null]).into()
    }

    pub(in super::super) fn unknown_distance() -> Schema {
        super::unknown_distance(&[Type::Null]).into()
    }
}
