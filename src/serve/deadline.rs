//! Deadlines of clients: a call that has not begun its answer by then is dropped, and with it what
//! is left of its work. A stream that has begun ends itself, by the deadline that is attached here. What
//! is no stream ends after a while in any case: a client that sends a byte a minute is not waited for.

use std::pin::Pin;
use std::task::{Context, Poll};
use std::time::Duration;

use tonic::codegen::http::{Request, Response};
use tower_layer::Layer;
use tower_service::Service;

use super::access::rule;
use crate::wire::Deadline;

/// How long a call that is no stream may take, as a request over HTTP.
const MOST: Duration = Duration::from_secs(60);

/// Answers DEADLINE_EXCEEDED when time is up. The transport by itself would say CANCELLED, as if the
/// client had gone away.
#[derive(Debug, Clone, Copy)]
pub(super) struct Deadlines;

impl<S> Layer<S> for Deadlines {
    type Service = Timed<S>;

    fn layer(&self, inner: S) -> Timed<S> {
        Timed { inner, most: MOST }
    }
}

/// A service whose calls end with their deadlines.
#[derive(Debug, Clone)]
pub(super) struct Timed<S> {
    inner: S,
    most: Duration,
}

impl<S, Q, A> Service<Request<Q>> for Timed<S>
where
    S: Service<Request<Q>, Response = Response<A>>,
    S::Future: Send + 'static,
    S::Error: Send + 'static,
    A: Default + Send + 'static,
{
    type Response = Response<A>;
    type Error = S::Error;
    type Future = Pin<Box<dyn Future<Output = Result<Response<A>, S::Error>> + Send>>;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        self.inner.poll_ready(context)
    }

    fn call(&mut self, mut request: Request<Q>) -> Self::Future {
        // The clock runs from here on, and so before that of the transport.
        let said = Deadline::of(request.headers());
        if let Some(deadline) = said {
            deadline.attach(request.extensions_mut());
        }
        let is_stream = rule(request.method().as_str(), request.uri().path()).is_stream;
        let ours = (!is_stream).then(|| Deadline::within(self.most));
        let answer = self.inner.call(request);
        let deadline = match (said, ours) {
            (Some(said), Some(ours)) => said.sooner(ours),
            (Some(deadline), None) | (None, Some(deadline)) => deadline,
            (None, None) => return Box::pin(answer),
        };
        Box::pin(
            async move { deadline.race(answer).await.unwrap_or_else(|late| Ok(late.into_http())) },
        )
    }
}

#[cfg(test)]
mod tests {
    use tonic::Status;
    use tonic::codegen::http::HeaderValue;

    use super::*;

    /// Never answers.
    struct Silent;

    impl Service<Request<()>> for Silent {
        type Response = Response<()>;
        type Error = std::convert::Infallible;
        type Future = std::future::Pending<Result<Response<()>, Self::Error>>;

        fn poll_ready(&mut self, _context: &mut Context<'_>) -> Poll<Result<(), Self::Error>> {
            Poll::Ready(Ok(()))
        }

        fn call(&mut self, _request: Request<()>) -> Self::Future {
            std::future::pending()
        }
    }

    #[tokio::test]
    async fn a_call_ends_in_any_case_and_a_stream_does_not() {
        let most = Duration::from_millis(3);
        for timeout in [None, Some("99999999H")] {
            let mut request = Request::new(());
            if let Some(timeout) = timeout {
                request.headers_mut().insert("grpc-timeout", HeaderValue::from_static(timeout));
            }
            let answer = Timed { inner: Silent, most }.call(request).await.expect("infallible");
            let status = Status::from_header_map(answer.headers()).expect("a status");
            assert_eq!(status.code(), tonic::Code::DeadlineExceeded);
            assert!(status.message().contains("3ms"), "{}", status.message());
        }
        let frames = Request::post("/orenx.v1.Ingest/StreamFrames").body(()).expect("a request");
        let mut stream = Timed { inner: Silent, most: Duration::ZERO }.call(frames);
        let look =
            |context: &mut Context<'_>| Poll::Ready(stream.as_mut().poll(context).is_pending());
        assert!(std::future::poll_fn(look).await, "it goes on");
    }

    #[tokio::test]
    async fn a_deadline_that_passes_is_told_as_such() {
        let mut request = Request::new(());
        request.headers_mut().insert("grpc-timeout", HeaderValue::from_static("1u"));
        let answer = Deadlines.layer(Silent).call(request).await.expect("infallible");
        let status = Status::from_header_map(answer.headers()).expect("a status");
        assert_eq!(status.code(), tonic::Code::DeadlineExceeded);
        assert!(status.message().contains("1µs"), "{}", status.message());
    }
}
