//! What every request passes: the size of its headers, a place among those under way, a deadline,
//! and the count of what became of it.

use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderMap, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use http_body_util::BodyExt;

use super::super::access::{Asked, Transport, rule};
use super::super::connection::Peer;
use super::Edge;
use super::options::MAX_INTEGER;
use super::refusal::Refusal;
use crate::error::Error;

/// The header in which a client says how long it will wait, ms.
pub(super) const TIMEOUT: &str = "orenx-timeout-ms";

/// How the route ends of what takes in files with PUT.
const UPLOAD: &str = "/snapshots/{name}";

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
    check_origin(request.headers(), &edge.written.server.cors_origins)?;
    let asked = Asked {
        transport: Transport::Http,
        rule: route.map(|route| rule(request.method().as_str(), route)),
        headers: request.headers(),
        peer: request.extensions().get::<Peer>().map(|peer| peer.0.ip()),
    };
    let admitted = edge.entrance.gate.admit(&asked)?;
    tracing::Span::current().record("client", &*admitted.client);
    let is_upload = request.method() == Method::PUT && route.is_some_and(|r| r.ends_with(UPLOAD));
    let most = if is_upload { edge.limits.upload_time } else { edge.limits.request_time };
    let patience = patience(request.headers(), most)?;
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
    let answer = tokio::time::timeout(patience, next.run(request)).await;
    let answer = answer.map_err(|_| late(patience))?;
    Ok(match admitted.place {
        None => answer,
        // A refusal ends at once.
        Some(_) if !answer.status().is_success() => answer,
        // The place of a stream is given back with its end.
        Some(place) => answer.map(|body| {
            Body::new(body.map_frame(move |frame| {
                let _held = &place;
                frame
            }))
        }),
    })
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

/// Refuses what a page of another site makes a browser send, unless it is one of `origins`: it could
/// empty a map behind its user's back, as long as nobody has to say who they are.
fn check_origin(headers: &HeaderMap, origins: &[String]) -> Result<(), Refusal> {
    let Some(origin) = headers.get(header::ORIGIN) else { return Ok(()) };
    if origins.iter().any(|known| known.as_bytes() == origin.as_bytes()) {
        return Ok(());
    }
    let site = origin.to_str().ok().and_then(|origin| origin.split_once("://"));
    let host = headers.get(header::HOST).and_then(|host| host.to_str().ok());
    match site {
        Some((_, site)) if Some(site) == host => Ok(()),
        _ => {
            let problem = format!("{origin:?} is another site, and those may not ask");
            Err(Refusal::new(StatusCode::FORBIDDEN, "PERMISSION_DENIED", problem).of("origin"))
        }
    }
}

/// How long the client and we have patience.
fn patience(headers: &HeaderMap, most: Duration) -> Result<Duration, Refusal> {
    let Some(value) = headers.get(TIMEOUT) else { return Ok(most) };
    let digits = value.to_str().ok().filter(|text| text.bytes().all(|b| b.is_ascii_digit()));
    let ms = digits.and_then(|text| text.parse().ok()).filter(|ms| (1..=MAX_INTEGER).contains(ms));
    let ms = ms.ok_or_else(|| {
        let problem = format!("{value:?} must be milliseconds within 1..={MAX_INTEGER}");
        Error::invalid(TIMEOUT, problem)
    })?;
    Ok(Duration::from_millis(ms).min(most))
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;

    #[test]
    fn pages_of_other_sites_are_kept_out() {
        let asks = |origin: Option<&'static str>| {
            let host = Some((header::HOST, "127.0.0.1:7611"));
            let origin = origin.map(|origin| (header::ORIGIN, origin));
            let headers = host.into_iter().chain(origin);
            let headers = headers.map(|(name, text)| (name, HeaderValue::from_static(text)));
            check_origin(&headers.collect(), &["https://maps.example".into()]).is_ok()
        };
        assert!(asks(Some("https://maps.example")) && !asks(Some("http://maps.example")));
        assert!(asks(None) && asks(Some("http://127.0.0.1:7611")));
        for other in ["http://evil.example", "null", "", "http://127.0.0.1:8000"] {
            assert!(!asks(Some(other)), "{other}");
        }
    }

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
        assert_eq!(read("9007199254740991"), Some(most));
        for wrong in ["", "0", "-1", "+1", "1.5", "1 s", "9007199254740992"] {
            assert_eq!(read(wrong), None, "{wrong}");
        }
    }
}
