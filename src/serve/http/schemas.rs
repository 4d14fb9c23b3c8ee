//! Schemas of what the types alone do not say: ranges, lengths, null.

use serde_json::{Value, json};
use utoipa::openapi::schema::{
    ArrayBuilder, ArrayItems, KnownFormat, SchemaFormat, SchemaType, Type,
};
use utoipa::openapi::{ObjectBuilder, Schema};

use super::options::MAX_INTEGER;
use crate::encoder::MAX_TEXT_BYTES;
use crate::frame::MAX_DIMENSION;
use crate::geometry::MAX_COORDINATE_M;
use crate::service::{MAP_FRAME, MAX_CLASSES, MAX_MATCHES, MAX_PROMPTS};

fn integer_or_null() -> ObjectBuilder {
    ObjectBuilder::new()
        .schema_type(SchemaType::from_iter([Type::Integer, Type::Null]))
        .format(Some(SchemaFormat::KnownFormat(KnownFormat::Int64)))
        .minimum(Some(0))
        .maximum(Some(MAX_INTEGER as usize))
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

pub(super) fn colors() -> Schema {
    let text = "[r, g, b] of the surface close by, in the mean over the directions that it was seen \
                along, sRGB within 0..1; three nulls where none was seen with a color, whatever the unknown_policy.";
    list(three(number(&[Type::Null]))).description(Some(text)).into()
}

pub(super) fn text_scores() -> Schema {
    let text = "How well the text fits: a relevancy within 0..1, or a cosine where there are no \
                negatives; null away from surfaces that were seen with features.";
    list(number(&[Type::Null])).description(Some(text)).into()
}

pub(super) fn sphere_fields() -> Schema {
    let text = "The columns to answer; none means distance (as `clearance_m`), gradient and state.";
    let names = ["distance", "gradient", "occupancy", "state", "color"];
    let name =
        ObjectBuilder::new().schema_type(SchemaType::new(Type::String)).enum_values(Some(names));
    list(name)
        .schema_type(SchemaType::from_iter([Type::Array, Type::Null]))
        .description(Some(text))
        .into()
}

// Language.

fn texts(types: &[Type], most: usize) -> ArrayBuilder {
    let types = [&[Type::Array], types].concat();
    // Any character takes at most four bytes.
    let text = ObjectBuilder::new()
        .schema_type(SchemaType::new(Type::String))
        .min_length(Some(1))
        .max_length(Some(MAX_TEXT_BYTES / 4))
        .pattern(Some(r"\S"));
    list(text).schema_type(SchemaType::from_iter(types)).max_items(Some(most))
}

fn vectors(types: &[Type]) -> ArrayBuilder {
    let types = [&[Type::Array], types].concat();
    let bound = f64::from(f32::MAX);
    let vector = list(number(&[]).minimum(Some(-bound)).maximum(Some(bound)));
    list(vector.min_items(Some(1)).max_items(Some(MAX_DIMENSION)))
        .schema_type(SchemaType::from_iter(types))
        .max_items(Some(MAX_PROMPTS))
}

pub(super) fn words() -> Schema {
    let text = "What is looked for, each of at most 512 bytes.";
    texts(&[], MAX_PROMPTS).min_items(Some(1)).description(Some(text)).into()
}

pub(super) fn negatives() -> Schema {
    let text = "What it is compared with. Left out: object, things, stuff and texture; none: scores \
                are cosines.";
    texts(&[Type::Null], MAX_PROMPTS).description(Some(text)).into()
}

pub(super) fn class_names() -> Schema {
    let text = "Names of classes, each of at most 512 bytes.";
    texts(&[Type::Null], MAX_CLASSES).min_items(Some(1)).description(Some(text)).into()
}

pub(super) fn embeddings() -> Schema {
    let text = "Embeddings of the map's encoder, of any length but 0.";
    vectors(&[]).min_items(Some(1)).description(Some(text)).into()
}

/// Where words may stand instead.
pub(super) fn embeddings_or_null() -> Schema {
    let text = "Embeddings of the map's encoder, of any length but 0.";
    vectors(&[Type::Null]).min_items(Some(1)).description(Some(text)).into()
}

pub(super) fn words_or_null() -> Schema {
    let text = "What is looked for, each of at most 512 bytes.";
    texts(&[Type::Null], MAX_PROMPTS).min_items(Some(1)).description(Some(text)).into()
}

pub(super) fn negative_embeddings() -> Schema {
    let text = "What they are compared with; none: scores are cosines.";
    vectors(&[Type::Null]).description(Some(text)).into()
}

pub(super) fn class_scores() -> Schema {
    let text = "The cosine of the class; null where there is none.";
    list(number(&[Type::Null])).description(Some(text)).into()
}

pub(super) fn corner() -> Schema {
    let bound = f64::from(f32::MAX);
    three(number(&[]).minimum(Some(-bound)).maximum(Some(bound))).into()
}

pub(super) fn min_score() -> Schema {
    let text = "Places that score less do not count. Left out: 0.5 with negatives, 0.1 without.";
    let score = number(&[Type::Null]).minimum(Some(-1.0)).maximum(Some(1.0));
    score.description(Some(text)).into()
}

pub(super) fn top_k() -> Schema {
    let text = "At most so many matches; 10 by default.";
    integer_or_null().maximum(Some(MAX_MATCHES)).description(Some(text)).into()
}

// Cameras.

pub(super) fn translation() -> Schema {
    let within = number(&[]).minimum(Some(-MAX_COORDINATE_M)).maximum(Some(MAX_COORDINATE_M));
    three(within).description(Some("[x, y, z] of the camera, world metres.")).into()
}

pub(super) fn place() -> Schema {
    let within = number(&[]).minimum(Some(-MAX_COORDINATE_M)).maximum(Some(MAX_COORDINATE_M));
    three(within).description(Some("[x, y, z], world metres.")).into()
}

pub(super) fn rotation() -> Schema {
    let text = "[x, y, z, w] of a unit quaternion. A length that is off by up to 1e-2 is normalised; \
                more is refused.";
    let one = number(&[]).minimum(Some(-1.01)).maximum(Some(1.01));
    list(one).min_items(Some(4)).max_items(Some(4)).description(Some(text)).into()
}

// Options, where null is the same as leaving them out.

pub(super) fn frame_id() -> Schema {
    let names = [json!(""), json!(MAP_FRAME), Value::Null];
    let schema =
        ObjectBuilder::new().schema_type(SchemaType::from_iter([Type::String, Type::Null]));
    let text = "The frame of the points: \"map\", the world of the poses.";
    schema.enum_values(Some(names)).description(Some(text)).into()
}

pub(super) fn min_epoch() -> Schema {
    let text = "Fails with FAILED_PRECONDITION if the newest epoch is older; an INTEGRATED ack says \
                which epoch holds a frame.";
    integer_or_null().description(Some(text)).into()
}

pub(super) fn max_age() -> Schema {
    let text = "Fails with FAILED_PRECONDITION if the newest frame of that epoch came to the server \
                longer ago than this, ms. 0: any age.";
    integer_or_null().description(Some(text)).into()
}

pub(super) fn jpeg_quality() -> Schema {
    let text = "1 to 100 of a JPEG; 85 by default. Refused with other encodings.";
    integer_or_null().minimum(Some(1)).maximum(Some(100)).description(Some(text)).into()
}

pub(super) fn unknown_distance() -> Schema {
    let text = "The distance of unknown points under `free` (as it is) and `occupied` (negative), m. \
                Left out: as far as the map's distances reach. Refused under `report`.";
    // The least that a single float holds with all of its digits.
    let least = f64::from(f32::MIN_POSITIVE);
    let number = number(&[Type::Null]).minimum(Some(least)).maximum(Some(MAX_COORDINATE_M));
    number.description(Some(text)).into()
}

// Planners' questions.

fn within(low: f64, high: f64) -> ObjectBuilder {
    number(&[]).minimum(Some(low)).maximum(Some(high))
}

fn of_length(of: ObjectBuilder, length: usize) -> ArrayBuilder {
    list(of).min_items(Some(length)).max_items(Some(length))
}

pub(super) fn spheres() -> Schema {
    let text = "[x, y, z, r] of each sphere, m; r not below 0.";
    let bound = f64::from(f32::MAX);
    list(of_length(within(-bound, bound), 4)).description(Some(text)).into()
}

pub(super) fn trajectories() -> Schema {
    let text = "The poses of each trajectory, at least one: world_from_body as [x, y, z] in metres, then \
                the unit quaternion [x, y, z, w].";
    let pose = of_length(within(-MAX_COORDINATE_M, MAX_COORDINATE_M), 7);
    list(list(pose).min_items(Some(1))).description(Some(text)).into()
}

pub(super) fn vectors_or_null() -> Schema {
    list(three(number(&[Type::Null]))).into()
}

pub(super) fn numbers_or_null() -> Schema {
    list(number(&[Type::Null])).into()
}

pub(super) fn margin() -> Schema {
    let text = "A clearance below this is a hit, m; 0 by default.";
    let margin = number(&[Type::Null]).minimum(Some(-100.0)).maximum(Some(100.0));
    margin.description(Some(text)).into()
}

pub(super) fn max_range() -> Schema {
    let text = "Where rays end, m. A ray counts as one point each 0.1 m.";
    within(1e-6, 1000.0).description(Some(text)).into()
}

pub(super) fn max_unknown() -> Schema {
    let text = "How far to look for space that nobody has seen, m. Left out or 0: not at all.";
    let far = number(&[Type::Null]).minimum(Some(0.0)).maximum(Some(2.0));
    far.description(Some(text)).into()
}

pub(super) fn voxel() -> Schema {
    within(0.001, 100.0).description(Some("Edge of a voxel, m.")).into()
}

pub(super) fn min_interval() -> Schema {
    let text = "Events are at least this far apart, ms; 100 by default.";
    integer_or_null().maximum(Some(3_600_000)).description(Some(text)).into()
}

pub(super) fn tolerance() -> Schema {
    let text = "A brick is told again once a distance in it changed by more than this, m, or a state. \
                Left out or 0: any change.";
    let tolerance = number(&[Type::Null]).minimum(Some(0.0)).maximum(Some(10.0));
    tolerance.description(Some(text)).into()
}

pub(super) fn clearance_drop() -> Schema {
    let text = "An event also when the least clearance of a trajectory fell by more than this since the \
                last event, m. Left out or 0: not.";
    let drop = number(&[Type::Null]).minimum(Some(0.0)).maximum(Some(10.0));
    drop.description(Some(text)).into()
}
