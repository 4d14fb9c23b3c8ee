//! Which form a body has and which one an answer gets.

use axum::http::{HeaderMap, StatusCode, header};

use super::refusal::Refusal;

/// The two forms of questions and answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Media {
    Json,
    /// Little-endian numbers as they lie in memory.
    Raw,
}

const NAMES: [(Media, &str); 2] =
    [(Media::Json, "application/json"), (Media::Raw, "application/octet-stream")];

impl Media {
    /// What the body says that it is.
    pub(super) fn of_body(headers: &HeaderMap) -> Result<Self, Refusal> {
        let value = headers.get(header::CONTENT_TYPE).map(|value| value.to_str().unwrap_or("?"));
        let name = value.unwrap_or_default().split(';').next().unwrap_or_default().trim();
        let known = NAMES.iter().find(|(_, known)| known.eq_ignore_ascii_case(name));
        known.map(|(media, _)| *media).ok_or_else(|| {
            unsupported(format!("'{name}' is neither {} nor {}", NAMES[0].1, NAMES[1].1))
        })
    }

    /// Refuses a body that does not say that it is JSON.
    pub(super) fn json_body(headers: &HeaderMap) -> Result<(), Refusal> {
        match Self::of_body(headers)? {
            Self::Json => Ok(()),
            Self::Raw => {
                let problem = format!("'{}' is not {}", NAMES[1].1, NAMES[0].1);
                Err(unsupported(problem))
            }
        }
    }

    /// What the client likes best; without a preference, the form of the question.
    pub(super) fn of_answer(headers: &HeaderMap, question: Self) -> Result<Self, Refusal> {
        let other = if question == Self::Json { Self::Raw } else { Self::Json };
        let forms = [question, other];
        Ok(forms[Self::best(headers, &forms.map(Self::name))?])
    }

    /// The place of the type that the client likes best; of those that it likes as well, the first.
    pub(super) fn best(headers: &HeaderMap, types: &[&str]) -> Result<usize, Refusal> {
        let mut likes = Vec::new();
        for value in headers.get_all(header::ACCEPT) {
            likes.extend(value.to_str().unwrap_or_default().split(',').filter_map(like));
        }
        if likes.is_empty() {
            return Ok(0);
        }
        let (mut best, mut most) = (None, 0.0);
        for (at, name) in types.iter().enumerate() {
            let weight = weight(&likes, name);
            if weight > most {
                (best, most) = (Some(at), weight);
            }
        }
        best.ok_or_else(|| {
            let problem = format!("there are {}", types.join(" and "));
            Refusal::new(StatusCode::NOT_ACCEPTABLE, "NOT_ACCEPTABLE", problem).of("accept")
        })
    }

    fn name(self) -> &'static str {
        let [(_, json), (_, raw)] = NAMES;
        match self {
            Self::Json => json,
            Self::Raw => raw,
        }
    }
}

/// One entry of an accept header and its weight (RFC 9110, 12.5.1); a weight that is none counts
/// as 1.
fn like(entry: &str) -> Option<(String, f32)> {
    let mut parts = entry.split(';').map(str::trim);
    let range = parts.next().filter(|range| !range.is_empty())?.to_ascii_lowercase();
    let quality = parts.find_map(|p| p.strip_prefix("q=").or_else(|| p.strip_prefix("Q=")));
    Some((range, quality.and_then(|q| q.parse().ok()).unwrap_or(1.0)))
}

/// The weight of the most specific entry that covers a type.
fn weight(likes: &[(String, f32)], name: &str) -> f32 {
    let group = name.split('/').next().unwrap_or_default();
    ["*/*", &format!("{group}/*"), name]
        .iter()
        .filter_map(|range| likes.iter().find(|(like, _)| like == range))
        .next_back()
        .map_or(0.0, |(_, weight)| *weight)
}

fn unsupported(problem: String) -> Refusal {
    let status = StatusCode::UNSUPPORTED_MEDIA_TYPE;
    Refusal::new(status, "UNSUPPORTED_MEDIA_TYPE", problem).of("content-type")
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;

    fn headers(name: header::HeaderName, text: &'static str) -> HeaderMap {
        HeaderMap::from_iter([(name, HeaderValue::from_static(text))])
    }

    #[test]
    fn a_body_says_what_it_is() {
        let read = |text| Media::of_body(&headers(header::CONTENT_TYPE, text)).ok();
        assert_eq!(read("application/json"), Some(Media::Json));
        assert_eq!(read("Application/JSON; charset=utf-8"), Some(Media::Json));
        assert_eq!(read("application/octet-stream"), Some(Media::Raw));
        for other in ["", "text/plain", "application/x-www-form-urlencoded", "json", "*/*"] {
            assert_eq!(read(other), None, "{other}");
        }
        assert!(Media::of_body(&HeaderMap::new()).is_err());
    }

    #[test]
    fn an_answer_has_the_form_that_is_liked_best() {
        use Media::{Json, Raw};
        let cases = [
            ("*/*", Json, Some(Json)),
            ("*/*", Raw, Some(Raw)),
            ("application/octet-stream", Json, Some(Raw)),
            ("application/json", Raw, Some(Json)),
            ("application/*;q=0.5, application/json", Raw, Some(Json)),
            ("application/octet-stream;q=0.3,application/json;q=0.2", Json, Some(Raw)),
            ("text/html, application/xml;q=0.9, */*;q=0.8", Json, Some(Json)),
            ("application/json;q=0, */*", Json, Some(Raw)),
            ("text/html", Json, None),
            ("application/json;q=0", Json, None),
            ("", Raw, Some(Raw)),
        ];
        for (accept, question, expected) in cases {
            let found = Media::of_answer(&headers(header::ACCEPT, accept), question).ok();
            assert_eq!(found, expected, "{accept}");
        }
        assert_eq!(Media::of_answer(&HeaderMap::new(), Raw).ok(), Some(Raw));
    }
}
