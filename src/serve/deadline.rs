//! Deadlines of clients: a call that has not begun its answer by then is dropped, and with it what
//! is left of its work. A stream that has begun ends itself, by the deadline that is attached here.

use std::pin::Pin;
use std::task::{Context, Poll};

use tonic::codegen::http::{Request, Response};
use tower_layer::Layer;
use tower_service::Service;

use crate::wire::Deadline;

/// Answers DEADLINE_EXCEEDED when time is up. The transport by itself would say CANCELLED, as if the
/// client had gone away.
#[derive(Debug, Clone, Copy)]
pub(super) struct Deadlines;

impl<S> Layer<S> for Deadlines {
    type Service = Timed<S>;

    fn layer(&self, inner: S) -> Timed<S> {
        Timed(inner)
    }
}

/// A service whose calls end with their deadlines.
#[derive(Debug, Clone)]
pub(super) struct Timed<S>(S);

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
        self.0.poll_ready(context)
    }

    fn call(&mut self, mut request: Request<Q>) -> Self::Future {
        // The clock runs from here on, and so before that of the transport.
        let Some(deadline) = Deadline::of(request.headers()) else {
            return Box::pin(self.0.call(request));
        };
        deadline.attach(request.extensions_mut());
        let answer = self.0.call(request);
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
    async fn a_deadline_that_passes_is_told_as_such() {
        let mut request = Request::new(());
        request.headers_mut().insert("grpc-timeout", HeaderValue::from_static("1u"));
        let answer = Deadlines.layer(Silent).call(request).await.expect("infallible");
        let status = Status::from_header_map(answer.headers()).expect("a status");
        assert_eq!(status.code(), tonic::Code::DeadlineExceeded);
        assert!(status.message().contains("1µs"), "{}", status.message());
    }
}
