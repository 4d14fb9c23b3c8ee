//! What every request passes: the size of its headers, a place among those under way, a deadline,
//! and the count of what became of it.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderMap, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::Edge;
use super::refusal::Refusal;
use crate::error::Error;

/// The header in which a client says how long it will wait, ms.
pub(super) const TIMEOUT: &str = "orenx-timeout-ms";

/// Counts a request whatever becomes of it: one that is dropped belongs to a client that left.
pub(super) async fn guard(State(edge): State<Arc<Edge>>, request: Request, next: Next) -> Response {
    let route = request.extensions().get::<MatchedPath>().map(|path| path.as_str().to_owned());
    let count = edge.requests.begin(route.as_deref());
    let response = admit(&edge, route.as_deref(), request, next)
        .await
        .unwrap_or_else(IntoResponse::into_response);
    count.end(response.status());
    response
}

async fn admit(
    edge: &Edge,
    route: Option<&str>,
    request: Request,
    next: Next,
) -> Result<Response, Refusal> {
    check_headers(&request, edge.limits.header_bytes)?;
    let patience = patience(request.headers(), edge.limits.request_time)?;
    // Probes and metrics must answer when nothing else does.
    let _place = match route {
        Some(route) if route.starts_with("/v1/") => {
            Some(edge.places.try_acquire().map_err(|_| {
                Refusal::from(Error::ResourceExhausted {
                    what: "requests under way".into(),
                    limit: format!("the limit is {}", edge.limits.requests),
                })
            })?)
        }
        _ => None,
    };
    tokio::time::timeout(patience, next.run(request)).await.map_err(|_| late(patience))
}

fn late(patience: Duration) -> Refusal {
    Error::DeadlineExceeded(format!("no answer within {patience:?}")).into()
}

fn check_headers(request: &Request, limit: usize) -> Result<(), Refusal> {
    let headers: usize = request.headers().iter().map(|(k, v)| k.as_str().len() + v.len()).sum();
    let bytes = headers + request.uri().path().len() + request.uri().query().map_or(0, str::len);
    if bytes > limit {
        let problem = format!("{bytes} bytes with the path; the limit is {limit}");
        let status = StatusCode::REQUEST_HEADER_FIELDS_TOO_LARGE;
        return Err(Refusal::new(status, "HEADERS_TOO_LARGE", problem).of("headers"));
    }
    Ok(())
}

/// How long the client and we have patience.
fn patience(headers: &HeaderMap, most: Duration) -> Result<Duration, Refusal> {
    let Some(value) = headers.get(TIMEOUT) else { return Ok(most) };
    let digits = value.to_str().ok().filter(|text| text.bytes().all(|b| b.is_ascii_digit()));
    let ms = digits.and_then(|text| text.parse::<u64>().ok()).filter(|ms| *ms > 0);
    let ms = ms.ok_or_else(|| {
        let problem = format!("{value:?} must be a whole number of milliseconds, at least 1");
        Error::invalid(TIMEOUT, problem)
    })?;
    Ok(Duration::from_millis(ms).min(most))
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;

    #[test]
    fn patience_is_the_clients_within_ours() {
        let most = Duration::from_secs(60);
        let read = |text: &'static str| {
            let value = HeaderValue::from_static(text);
            let name = axum::http::HeaderName::from_static(TIMEOUT);
            patience(&HeaderMap::from_iter([(name, value)]), most).ok()
        };
        assert_eq!(patience(&HeaderMap::new(), most).ok(), Some(most));
        assert_eq!(read("250"), Some(Duration::from_millis(250)));
        assert_eq!(read("18446744073709551615"), Some(most));
        for wrong in ["", "0", "-1", "+1", "1.5", "1 s", "18446744073709551616"] {
            assert_eq!(read(wrong), None, "{wrong}");
        }
    }
}
