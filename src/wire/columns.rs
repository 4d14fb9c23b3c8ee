//! Answers over HTTP without JSON: columns of little-endian numbers, back to back, and the header
//! that says where each one is.

use std::fmt::Write;

use bytes::Bytes;
use glam::Vec3;

use crate::error::{Error, Result};
use crate::map::{Fields, PointAnswers};

/// The header with the columns of a body: a structured list (RFC 9651) such as
/// `distance_m;type=f32;width=1;offset=0, state;type=u8;width=1;offset=4000`. A column holds `width`
/// numbers of `type` for each point, from byte `offset` on; as many columns as there are.
pub const COLUMNS: &str = "orenx-columns";
/// The headers with the rest of an answer.
pub const POINTS: &str = "orenx-points";
pub const EPOCH: &str = "orenx-epoch";
pub const NEWEST_STAMP_NS: &str = "orenx-newest-stamp-ns";
pub const SERVER_US: &str = "orenx-server-us";
/// And those of an image: pixels a row, and rows.
pub const WIDTH: &str = "orenx-width";
pub const HEIGHT: &str = "orenx-height";

// Columns leave and points come in as they lie in memory.
const _: () = assert!(cfg!(target_endian = "little"), "raw bodies are little-endian");

/// The columns of an answer to `points` points, and their header. Nothing is copied. A column that
/// the map does not have is not there.
pub fn columns_to_wire(
    answers: PointAnswers,
    fields: Fields,
    points: usize,
) -> (String, Vec<Bytes>) {
    named_columns_to_wire("distance_m", answers, fields, points)
}

/// [`columns_to_wire`] with another name for the distances.
pub fn named_columns_to_wire(
    distance: &str,
    answers: PointAnswers,
    fields: Fields,
    points: usize,
) -> (String, Vec<Bytes>) {
    let mut columns = Columns::new(points);
    columns.push(distance, fields.distance, 1, answers.distance);
    columns.push("gradient", fields.gradient, 3, answers.gradient);
    columns.push("occupancy", fields.occupancy, 1, answers.occupancy);
    columns.push("color", fields.color, 3, answers.color);
    columns.push("text_score", fields.text_score, 1, answers.text_score);
    // The last one, so that the numbers before it lie on whole words.
    columns.push("state", fields.state, 1, answers.state);
    columns.finish()
}

/// Columns of one length, as they are put together.
#[derive(Debug)]
pub struct Columns {
    points: usize,
    header: String,
    parts: Vec<Bytes>,
    offset: usize,
}

impl Columns {
    /// Columns of `points` rows.
    pub fn new(points: usize) -> Self {
        Self { points, header: String::new(), parts: Vec::new(), offset: 0 }
    }

    /// The header and the parts of the body.
    pub fn finish(self) -> (String, Vec<Bytes>) {
        (self.header, self.parts)
    }

    /// Adds a column, if it was asked for and is there: f32, or bytes.
    pub fn push<T: bytemuck::NoUninit + Send>(
        &mut self,
        name: &str,
        is_asked: bool,
        width: usize,
        values: Vec<T>,
    ) {
        if is_asked && values.len() == self.points {
            let kind = if size_of::<T>() == 1 { "u8" } else { "f32" };
            self.push_part(name, kind, width, Bytes::from_owner(AsBytes(values)));
        }
    }

    /// Adds a column of numbers that are bytes already; none if there are none.
    pub fn push_bytes(&mut self, name: &str, kind: &str, width: usize, values: Vec<u8>) {
        if !values.is_empty() {
            self.push_part(name, kind, width, Bytes::from(values));
        }
    }

    fn push_part(&mut self, name: &str, kind: &str, width: usize, part: Bytes) {
        let comma = if self.header.is_empty() { "" } else { ", " };
        // Writing to a string cannot fail.
        let _ =
            write!(self.header, "{comma}{name};type={kind};width={width};offset={}", self.offset);
        self.offset += part.len();
        self.parts.push(part);
    }
}

/// A column as the bytes that it is.
struct AsBytes<T>(Vec<T>);

impl<T: bytemuck::NoUninit> AsRef<[u8]> for AsBytes<T> {
    fn as_ref(&self) -> &[u8] {
        bytemuck::cast_slice(&self.0)
    }
}

/// The answer that `header` and `body` hold. Columns that we do not know are left out.
pub fn columns_from_wire(header: &str, body: &[u8], points: usize) -> Result<PointAnswers> {
    let mut answers = PointAnswers::default();
    for entry in header.split(',') {
        let mut parts = entry.trim().split(';');
        let name = parts.next().unwrap_or_default();
        let (mut kind, mut width, mut offset) = ("", None, None);
        for part in parts {
            match part.trim().split_once('=') {
                Some(("type", value)) => kind = value,
                Some(("width", value)) => width = value.parse::<usize>().ok(),
                Some(("offset", value)) => offset = value.parse::<usize>().ok(),
                _ => {}
            }
        }
        let wrong = || Error::corrupt("the server's answer", format!("{COLUMNS}: '{entry}'"));
        let (width, offset) = width.zip(offset).ok_or_else(wrong)?;
        let size = if kind == "u8" { 1 } else { 4 };
        let length = points.checked_mul(width).and_then(|n| n.checked_mul(size));
        let end = length.and_then(|length| offset.checked_add(length)).ok_or_else(wrong)?;
        let bytes = body.get(offset..end).ok_or_else(wrong)?;
        match (name, kind, width) {
            ("distance_m", "f32", 1) => answers.distance = numbers(bytes),
            ("gradient", "f32", 3) => answers.gradient = vectors(bytes),
            ("occupancy", "f32", 1) => answers.occupancy = numbers(bytes),
            ("state", "u8", 1) => answers.state = bytes.to_vec(),
            ("color", "f32", 3) => answers.color = vectors(bytes),
            ("text_score", "f32", 1) => answers.text_score = numbers(bytes),
            _ => {}
        }
    }
    Ok(answers)
}

fn vectors(bytes: &[u8]) -> Vec<Vec3> {
    numbers(bytes).chunks_exact(3).map(Vec3::from_slice).collect()
}

fn numbers(bytes: &[u8]) -> Vec<f32> {
    bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answers() -> PointAnswers {
        PointAnswers {
            distance: vec![0.5, f32::NAN],
            gradient: vec![Vec3::X, Vec3::NAN],
            occupancy: vec![],
            state: vec![1, 0],
            color: vec![Vec3::NAN, Vec3::ONE],
            text_score: vec![0.25, f32::NAN],
        }
    }

    #[test]
    fn columns_come_back_bit_for_bit() {
        let fields = Fields { text_score: true, ..Fields::ALL };
        let (header, parts) = columns_to_wire(answers(), fields, 2);
        assert_eq!(
            header,
            "distance_m;type=f32;width=1;offset=0, gradient;type=f32;width=3;offset=8, \
             color;type=f32;width=3;offset=32, text_score;type=f32;width=1;offset=56, \
             state;type=u8;width=1;offset=64"
        );
        let body = parts.concat();
        assert_eq!(body.len(), 66);
        assert_eq!(body[..4], 0.5f32.to_le_bytes());
        let back = columns_from_wire(&header, &body, 2).expect("our own");
        assert_eq!(format!("{back:?}"), format!("{:?}", answers()));
        assert_eq!(back.gradient[1].x.to_bits(), f32::NAN.to_bits());
    }

    #[test]
    fn only_what_was_asked_for_is_sent() {
        let (header, parts) = columns_to_wire(answers(), Fields::DISTANCE, 2);
        assert_eq!(header, "distance_m;type=f32;width=1;offset=0");
        assert_eq!(parts.concat().len(), 8);
    }

    #[test]
    fn a_header_that_points_elsewhere_is_refused() {
        let body = [0; 16];
        for header in [
            "",
            "distance_m",
            "distance_m;type=f32;width=1",
            "distance_m;type=f32;width=1;offset=13",
            "state;type=u8;width=1;offset=18446744073709551615",
            "gradient;type=f32;width=18446744073709551615;offset=0",
        ] {
            assert!(columns_from_wire(header, &body, 1).is_err(), "{header}");
        }
        let newer = "heat;type=f32;width=1;offset=0";
        assert_eq!(columns_from_wire(newer, &body, 1).expect("skipped"), PointAnswers::default());
    }
}
