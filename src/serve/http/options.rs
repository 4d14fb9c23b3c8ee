//! What a question may ask for beside its points.

use std::time::Duration;

use glam::Vec3;
use percent_encoding::percent_decode_str;
use serde::Deserialize;
use utoipa::ToSchema;

use super::refusal::Refusal;
use crate::error::Error;
use crate::map::Fields;
use crate::service::{
    PointsQuestion, Sought, Terms, Unknown, UnknownPolicy, check_frame_id, check_unknown_distance,
};

/// A column.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub(super) enum Field {
    Distance,
    Gradient,
    Occupancy,
    State,
    Color,
    /// Needs `text`.
    #[serde(rename = "text_score")]
    TextScore,
}

/// How an answer treats what nobody has seen: `report` with null (raw: NaN), `free` as open space,
/// `occupied` as the inside of an obstacle. The state says unknown in any case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub(super) enum Policy {
    Report,
    Free,
    Occupied,
}

/// The options in a query string; the body's own go before them.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Options {
    pub(super) frame_id: Option<String>,
    /// None means all of them; in a query string with commas between them.
    pub(super) fields: Option<Vec<Field>>,
    pub(super) min_epoch: Option<u64>,
    pub(super) max_age_ms: Option<u64>,
    pub(super) unknown_policy: Option<Policy>,
    pub(super) unknown_distance_m: Option<f32>,
    /// What is scored; in a query string words alone, with commas between them.
    pub(super) text: Option<Sought>,
}

/// The largest integer that JSON readers in all languages hold exactly: 2^53 - 1.
pub(super) const MAX_INTEGER: u64 = (1 << 53) - 1;

const FIELDS: [(&str, Field); 6] = [
    ("distance", Field::Distance),
    ("gradient", Field::Gradient),
    ("occupancy", Field::Occupancy),
    ("state", Field::State),
    ("color", Field::Color),
    ("text_score", Field::TextScore),
];
pub(super) const POLICIES: [(&str, Policy); 3] =
    [("report", Policy::Report), ("free", Policy::Free), ("occupied", Policy::Occupied)];

impl Options {
    /// Reads a query string; a key that does not exist, or twice, is an error. Values are checked even
    /// if the body has others.
    pub(super) fn of_query(query: Option<&str>) -> Result<Self, Refusal> {
        let (mut options, mut prompts, mut negatives) = (Self::default(), None, None);
        for pair in query.unwrap_or_default().split('&').filter(|pair| !pair.is_empty()) {
            let (key, value) = pair.split_once('=').unwrap_or((pair, ""));
            let (key, text) = (decoded(key)?, value);
            let value = decoded(text)?;
            let is_first = match key.as_str() {
                "frame_id" => {
                    check_frame_id(&value)?;
                    options.frame_id.replace(value).is_none()
                }
                "fields" => options.fields.replace(list(&value)?).is_none(),
                "min_epoch" => options.min_epoch.replace(number(&key, &value)?).is_none(),
                "max_age_ms" => options.max_age_ms.replace(number(&key, &value)?).is_none(),
                "unknown_policy" => {
                    let policy = one_of(&key, &value, &POLICIES)?;
                    options.unknown_policy.replace(policy).is_none()
                }
                "unknown_distance_m" => {
                    let distance_m = number(&key, &value)?;
                    check_unknown_distance(distance_m)?;
                    options.unknown_distance_m.replace(distance_m).is_none()
                }
                "prompts" => prompts.replace(words(text)?).is_none(),
                "negatives" => negatives.replace(words(text)?).is_none(),
                _ => {
                    let shown: String = key.chars().take(64).collect();
                    let known = "frame_id, fields, min_epoch, max_age_ms, unknown_policy, \
                                 unknown_distance_m, prompts, negatives";
                    return Err(Error::invalid(shown, format!("is none of {known}")).into());
                }
            };
            if !is_first {
                return Err(Error::invalid(key, "is there twice").into());
            }
        }
        options.text = match (prompts, negatives) {
            (Some(prompts), negatives) => Some(Sought::Words { prompts, negatives }),
            (None, None) => None,
            (None, Some(_)) => return Err(Error::invalid("negatives", "need prompts").into()),
        };
        options.check()?;
        Ok(options)
    }

    /// Refuses numbers that JSON does not hold exactly: no epoch and no age is so large.
    pub(super) fn check(&self) -> Result<(), Refusal> {
        check_integer("min_epoch", self.min_epoch)?;
        check_integer("max_age_ms", self.max_age_ms)
    }

    /// These, and where they leave something out the others.
    pub(super) fn or(self, other: Self) -> Self {
        Self {
            frame_id: self.frame_id.or(other.frame_id),
            fields: self.fields.or(other.fields),
            min_epoch: self.min_epoch.or(other.min_epoch),
            max_age_ms: self.max_age_ms.or(other.max_age_ms),
            unknown_policy: self.unknown_policy.or(other.unknown_policy),
            unknown_distance_m: self.unknown_distance_m.or(other.unknown_distance_m),
            text: self.text.or(other.text),
        }
    }

    /// What planners' questions have in common.
    pub(super) fn terms(&self, map_id: String) -> Terms {
        Terms {
            map_id,
            frame_id: self.frame_id.clone().unwrap_or_default(),
            min_epoch: self.min_epoch.unwrap_or_default(),
            max_age: self.max_age_ms.filter(|ms| *ms > 0).map(Duration::from_millis),
            unknown: self.unknown(),
        }
    }

    /// The fields of a planner's question; without any, the usual ones.
    pub(super) fn fields_or(&self, usual: Fields) -> Fields {
        let fields = self.fields.as_deref().unwrap_or_default();
        if fields.is_empty() {
            return usual;
        }
        let has = |field| fields.contains(&field);
        Fields {
            distance: has(Field::Distance),
            gradient: has(Field::Gradient),
            occupancy: has(Field::Occupancy),
            state: has(Field::State),
            color: has(Field::Color),
            text_score: has(Field::TextScore),
        }
    }

    fn unknown(&self) -> Unknown {
        Unknown {
            policy: match self.unknown_policy {
                None | Some(Policy::Report) => UnknownPolicy::Report,
                Some(Policy::Free) => UnknownPolicy::Free,
                Some(Policy::Occupied) => UnknownPolicy::Occupied,
            },
            distance_m: self.unknown_distance_m,
        }
    }

    /// The question that they make of points.
    pub(super) fn question(self, map_id: String, points: Vec<Vec3>) -> PointsQuestion {
        let unknown = self.unknown();
        let fields = self.fields.unwrap_or_default();
        let has = |field| fields.is_empty() || fields.contains(&field);
        PointsQuestion {
            map_id,
            frame_id: self.frame_id.unwrap_or_default(),
            points,
            fields: Fields {
                distance: has(Field::Distance),
                gradient: has(Field::Gradient),
                occupancy: has(Field::Occupancy),
                state: has(Field::State),
                color: has(Field::Color),
                text_score: self.text.is_some() || fields.contains(&Field::TextScore),
            },
            text: self.text,
            min_epoch: self.min_epoch.unwrap_or_default(),
            max_age: self.max_age_ms.filter(|ms| *ms > 0).map(Duration::from_millis),
            unknown,
        }
    }
}

/// Refuses a number that JSON does not hold exactly.
pub(super) fn check_integer(key: &str, number: Option<u64>) -> Result<(), Refusal> {
    match number.filter(|number| *number > MAX_INTEGER) {
        Some(number) => {
            let problem = format!("{number} must be within 0..={MAX_INTEGER}");
            Err(Error::invalid(key, problem).into())
        }
        None => Ok(()),
    }
}

pub(super) fn decoded(text: &str) -> Result<String, Refusal> {
    let spaced = text.replace('+', " ");
    let decoded = percent_decode_str(&spaced).decode_utf8();
    Ok(decoded.map_err(|_| Error::invalid("query string", "is not UTF-8"))?.into_owned())
}

/// Words between commas; a comma of a word is written as %2C.
fn words(text: &str) -> Result<Vec<String>, Refusal> {
    text.split(',').filter(|word| !word.is_empty()).map(decoded).collect()
}

pub(super) fn list(text: &str) -> Result<Vec<Field>, Refusal> {
    let names = text.split(',').filter(|name| !name.is_empty()).enumerate();
    names.map(|(at, name)| one_of(&format!("fields[{at}]"), name, &FIELDS)).collect()
}

pub(super) fn one_of<T: Copy>(key: &str, text: &str, all: &[(&str, T)]) -> Result<T, Refusal> {
    let found = all.iter().find(|(name, _)| *name == text).map(|(_, value)| *value);
    found.ok_or_else(|| {
        let names: Vec<&str> = all.iter().map(|(name, _)| *name).collect();
        let shown: String = text.chars().take(64).collect();
        Error::invalid(key, format!("'{shown}' is none of {}", names.join(", "))).into()
    })
}

pub(super) fn number<T: std::str::FromStr>(key: &str, text: &str) -> Result<T, Refusal>
where
    T::Err: std::fmt::Display,
{
    text.parse().map_err(|error| {
        let shown: String = text.chars().take(64).collect();
        Error::invalid(key, format!("'{shown}': {error}")).into()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_query_string_is_read_or_refused_by_key() {
        let read = |text| Options::of_query(Some(text));
        assert_eq!(Options::of_query(None).expect("none"), Options::default());
        assert_eq!(read("").expect("none"), Options::default());
        let all = "fields=state,distance&min_epoch=4&max_age_ms=500&unknown_policy=free\
                   &unknown_distance_m=1.5&frame_id=m%61p&prompts=red+chair,a%2Cb&negatives=";
        let expected = Options {
            frame_id: Some("map".into()),
            fields: Some(vec![Field::State, Field::Distance]),
            min_epoch: Some(4),
            max_age_ms: Some(500),
            unknown_policy: Some(Policy::Free),
            unknown_distance_m: Some(1.5),
            text: Some(Sought::Words {
                prompts: vec!["red chair".into(), "a,b".into()],
                negatives: Some(Vec::new()),
            }),
        };
        assert_eq!(read(all).expect(all), expected);
        for (text, words) in [
            ("field=state", ["field: ", "fields, min_epoch"]),
            ("fields=state,colour", ["fields[1]: ", "distance, gradient"]),
            ("min_epoch=-1", ["min_epoch: ", "'-1'"]),
            ("min_epoch=", ["min_epoch: ", "empty"]),
            ("max_age_ms=soon", ["max_age_ms: ", "'soon'"]),
            ("unknown_policy=hope", ["unknown_policy: ", "occupied"]),
            ("unknown_distance_m=x", ["unknown_distance_m: ", "'x'"]),
            ("unknown_distance_m=0", ["unknown_distance_m: ", "10000"]),
            ("frame_id=odom", ["frame_id: ", "map"]),
            ("min_epoch=9007199254740992", ["min_epoch: ", "9007199254740991"]),
            ("min_epoch=1&min_epoch=1", ["min_epoch: ", "twice"]),
            ("negatives=wall", ["negatives: ", "need prompts"]),
            ("frame_id=%ff", ["query string: ", "UTF-8"]),
        ] {
            let problem = format!("{:?}", read(text).expect_err(text));
            for word in words {
                assert!(problem.contains(word), "{word} in {problem}");
            }
        }
    }

    #[test]
    fn the_body_goes_before_the_query_string() {
        let body = Options { min_epoch: Some(3), ..Options::default() };
        let query = Options { min_epoch: Some(4), max_age_ms: Some(5), ..Options::default() };
        let question = body.or(query).question("default".into(), Vec::new());
        assert_eq!((question.min_epoch, question.max_age), (3, Some(Duration::from_millis(5))));
        assert_eq!(question.fields, Fields::ALL);
    }
}
