//! Deadlines of clients: a call that has not begun its answer by then is dropped, and with it what
//! is left of its work.

use std::pin::Pin;
use std::task::{Context, Poll};
use std::time::Duration;

use tonic::codegen::http::{HeaderMap, Request, Response};
use tower_layer::Layer;
use tower_service::Service;

use crate::error::Error;
use crate::wire::status_from_error;

/// The header in which a client says how long it will wait: digits and a unit, as in `250m`.
const TIMEOUT: &str = "grpc-timeout";

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

    fn call(&mut self, request: Request<Q>) -> Self::Future {
        let Some(left) = time_left(request.headers()) else {
            return Box::pin(self.0.call(request));
        };
        // The clock runs from here on, and so before that of the transport.
        let answer = tokio::time::timeout(left, self.0.call(request));
        Box::pin(async move {
            answer.await.unwrap_or_else(|_| {
                let late = Error::DeadlineExceeded(format!("no answer within {left:?}"));
                Ok(status_from_error(&late).into_http())
            })
        })
    }
}

/// What the client's header says; `None` if there is none or it is malformed, which gRPC ignores.
fn time_left(headers: &HeaderMap) -> Option<Duration> {
    let text = headers.get(TIMEOUT)?.to_str().ok()?;
    let (digits, unit) = text.split_at_checked(text.len().checked_sub(1)?)?;
    // At most eight digits, so that no unit overflows.
    if digits.len() > 8 || !digits.bytes().all(|b| b.is_ascii_digit()) {
        return None;
    }
    let n: u64 = digits.parse().ok()?;
    match unit {
        "H" => Some(Duration::from_secs(n * 3600)),
        "M" => Some(Duration::from_secs(n * 60)),
        "S" => Some(Duration::from_secs(n)),
        "m" => Some(Duration::from_millis(n)),
        "u" => Some(Duration::from_micros(n)),
        "n" => Some(Duration::from_nanos(n)),
        _ => None,
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
        request.headers_mut().insert(TIMEOUT, HeaderValue::from_static("1u"));
        let answer = Deadlines.layer(Silent).call(request).await.expect("infallible");
        let status = Status::from_header_map(answer.headers()).expect("a status");
        assert_eq!(status.code(), tonic::Code::DeadlineExceeded);
        assert!(status.message().contains("1µs"), "{}", status.message());
    }

    #[test]
    fn deadlines_are_read_or_ignored() {
        let read = |text: &str| {
            let value = HeaderValue::from_str(text).expect("a header");
            time_left(&HeaderMap::from_iter([(
                tonic::codegen::http::HeaderName::from_static(TIMEOUT),
                value,
            )]))
        };
        assert_eq!(read("250m"), Some(Duration::from_millis(250)));
        assert_eq!(read("99999999H"), Some(Duration::from_secs(99_999_999 * 3600)));
        assert_eq!(read("0n"), Some(Duration::ZERO));
        for wrong in ["", "m", "12", "1x", "-1S", "+1S", "123456789S", "1 S"] {
            assert_eq!(read(wrong), None, "{wrong}");
        }
        assert_eq!(time_left(&HeaderMap::new()), None);
    }
}
