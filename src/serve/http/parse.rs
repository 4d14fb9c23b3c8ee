//! JSON bodies, and which part of one is wrong.

use serde::Deserialize;
use serde::de::{DeserializeOwned, Deserializer, Error as _};
use serde_json::Number;

use super::options::MAX_INTEGER;
use super::refusal::Refusal;
use crate::error::Error;

/// Reads a body. A failure is looked for a second time, at leisure, to find its place.
pub(super) fn parse<T: DeserializeOwned>(body: &[u8]) -> Result<T, Refusal> {
    serde_json::from_slice(body).map_err(|error| {
        let mut again = serde_json::Deserializer::from_slice(body);
        match serde_path_to_error::deserialize::<_, T>(&mut again) {
            Err(error) => {
                let field = field_of(&error.path().to_string());
                Error::invalid(field, error.inner().to_string()).into()
            }
            // Whole, but something follows.
            Ok(_) => Error::invalid("body", error.to_string()).into(),
        }
    })
}

/// A whole number, or null. JSON knows one kind of number: 7.0 is 7.
pub(super) fn whole<'de, D: Deserializer<'de>>(json: D) -> Result<Option<u64>, D::Error> {
    let Some(number) = Option::<Number>::deserialize(json)? else { return Ok(None) };
    let range = 0.0..=MAX_INTEGER as f64;
    let is_whole = |n: &f64| n.fract() == 0.0 && range.contains(n);
    let whole = number.as_u64().or_else(|| number.as_f64().filter(is_whole).map(|n| n as u64));
    let problem = format_args!("{number} must be whole and within 0..={MAX_INTEGER}");
    whole.map(Some).ok_or_else(|| D::Error::custom(problem))
}

/// A number of pixels. What is too large for any image is refused with the others that are.
pub(super) fn pixels<'de, D: Deserializer<'de>>(json: D) -> Result<u32, D::Error> {
    let number = whole(json)?.ok_or_else(|| D::Error::custom("must be a whole number"))?;
    Ok(u32::try_from(number).unwrap_or(u32::MAX))
}

/// A path as the other transports name it: the third number of a point is its z.
fn field_of(path: &str) -> String {
    let axis = |rest: &str| match rest {
        "[0]" => Some(".x"),
        "[1]" => Some(".y"),
        "[2]" => Some(".z"),
        _ => None,
    };
    match path.strip_prefix("points_m").and_then(|rest| rest.split_once(']')) {
        Some((index, rest)) if let Some(axis) = axis(rest) => format!("points_m{index}]{axis}"),
        _ if path == "." => "body".into(),
        _ => path.into(),
    }
}
