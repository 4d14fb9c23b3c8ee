//! A name for each request, in its span of the log and in the headers of its answer, so that what a client
//! saw can be found in what the server said.

use std::hash::{BuildHasher, Hasher, RandomState};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::task::{Context, Poll};
use std::time::Instant;

use tonic::codegen::http::{HeaderMap, HeaderName, HeaderValue, Request, Response};
use tower_layer::Layer;
use tower_service::Service;
use tracing::Instrument;

use super::access::Transport;

/// Of the answer; over gRPC it is metadata.
pub(super) const REQUEST_ID: HeaderName = HeaderName::from_static("orenx-request-id");
/// Of the request, where the client has a name for it already.
pub(super) const GIVEN: &str = "x-request-id";
const MAX_BYTES: usize = 128;
/// Steps from one name to the next: odd, so that none comes twice.
const STEP: u64 = 0x9E37_79B9_7F4A_7C15;

/// Names what passes.
#[derive(Clone)]
pub(super) struct Naming {
    transport: Transport,
    next: Arc<AtomicU64>,
}

impl Naming {
    pub(super) fn new(transport: Transport) -> Self {
        // Another number in each process.
        let first = RandomState::new().build_hasher().finish();
        Self { transport, next: Arc::new(AtomicU64::new(first)) }
    }

    /// The client's own name for it, if it is one, else a new one.
    fn name(&self, headers: &HeaderMap) -> HeaderValue {
        let is_sane = |value: &&HeaderValue| {
            let is_plain = |b: &u8| b.is_ascii_alphanumeric() || b"._:-".contains(b);
            (1..=MAX_BYTES).contains(&value.len()) && value.as_bytes().iter().all(is_plain)
        };
        headers.get(GIVEN).filter(is_sane).cloned().unwrap_or_else(|| {
            let id = format!("{:016x}", self.next.fetch_add(STEP, Relaxed));
            HeaderValue::try_from(id).unwrap_or(HeaderValue::from_static("unnamed"))
        })
    }
}

impl<S> Layer<S> for Naming {
    type Service = Named<S>;

    fn layer(&self, inner: S) -> Named<S> {
        Named { inner, naming: self.clone() }
    }
}

/// A service whose requests have names.
#[derive(Clone)]
pub(super) struct Named<S> {
    inner: S,
    naming: Naming,
}

impl<S, Q, A> Service<Request<Q>> for Named<S>
where
    S: Service<Request<Q>, Response = Response<A>>,
    S::Future: Send + 'static,
{
    type Response = Response<A>;
    type Error = S::Error;
    type Future = Pin<Box<dyn Future<Output = Result<Response<A>, S::Error>> + Send>>;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        self.inner.poll_ready(context)
    }

    fn call(&mut self, request: Request<Q>) -> Self::Future {
        let begun = Instant::now();
        let id = self.naming.name(request.headers());
        let span = tracing::info_span!(
            "request",
            id = id.to_str().unwrap_or_default(),
            transport = self.naming.transport.name(),
            method = request.method().as_str(),
            path = request.uri().path(),
            client = tracing::field::Empty,
        );
        // What is done before the answer is waited for is part of it.
        let answer = span.in_scope(|| self.inner.call(request));
        let named = async move {
            let mut answer = answer.await?;
            let outcome = answer.headers().get("grpc-status").and_then(|v| v.to_str().ok());
            tracing::info!(
                status = answer.status().as_u16(),
                grpc_status = outcome,
                ms = begun.elapsed().as_secs_f64() * 1e3,
                "answered"
            );
            answer.headers_mut().insert(REQUEST_ID, id);
            Ok(answer)
        };
        Box::pin(named.instrument(span))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_client_may_name_its_request_and_nothing_else() {
        let naming = Naming::new(Transport::Http);
        let name = |given: &'static [u8]| {
            let value = HeaderValue::from_bytes(given).expect("a header");
            naming.name(&HeaderMap::from_iter([(HeaderName::from_static(GIVEN), value)]))
        };
        assert_eq!(name(b"robot-7:42_a.b"), "robot-7:42_a.b");
        let long: &[u8] = &[b'a'; MAX_BYTES + 1];
        for wrong in [b"".as_slice(), b"a b", b"a=b", b"a\"b", b"\xff", long] {
            let new = name(wrong);
            assert!(new.len() == 16 && new.as_bytes().iter().all(u8::is_ascii_hexdigit), "{new:?}");
        }
        assert_ne!(naming.name(&HeaderMap::new()), naming.name(&HeaderMap::new()));
    }
}
