//! What ends a call from outside: its client's deadline, or the server's way down.

use std::time::{Duration, Instant};

use tokio::sync::watch;
use tonic::codegen::http::{Extensions, HeaderMap};
use tonic::{Request, Status};

use super::status_from_error;
use crate::error::Error;

/// The header in which a client says how long it will wait: digits and a unit, as in `250m`.
const TIMEOUT: &str = "grpc-timeout";

/// Until when a client waits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Deadline {
    at: Instant,
    allowed: Duration,
}

impl Deadline {
    /// What a call's headers say, counted from now.
    pub fn of(headers: &HeaderMap) -> Option<Self> {
        let allowed = time_allowed(headers)?;
        Some(Self { at: Instant::now().checked_add(allowed)?, allowed })
    }

    /// So long from now.
    pub fn within(allowed: Duration) -> Self {
        Self { at: Instant::now() + allowed, allowed }
    }

    /// The earlier of two.
    pub fn sooner(self, other: Self) -> Self {
        if other.at < self.at { other } else { self }
    }

    /// Attaches the deadline to a call, for who streams: see [`Ending::of`].
    pub fn attach(self, extensions: &mut Extensions) {
        extensions.insert(self);
    }

    /// The outcome of `work`, or the status of a deadline that has passed.
    pub async fn race<T>(self, work: impl Future<Output = T>) -> Result<T, Status> {
        tokio::time::timeout_at(self.at.into(), work).await.map_err(|_| self.status())
    }

    fn status(self) -> Status {
        let late = Error::DeadlineExceeded(format!("no answer within {:?}", self.allowed));
        status_from_error(&late)
    }
}

/// What the client's header says; `None` if there is none or it is malformed, which gRPC ignores.
fn time_allowed(headers: &HeaderMap) -> Option<Duration> {
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

/// The end of a stream that the other side does not bring about.
#[derive(Debug)]
pub struct Ending {
    closing: watch::Receiver<bool>,
    deadline: Option<Deadline>,
}

impl Ending {
    /// `closing` turns true when streams must end; the call's deadline was attached on its way in.
    pub fn of<T>(request: &Request<T>, closing: watch::Receiver<bool>) -> Self {
        Self { closing, deadline: request.extensions().get().copied() }
    }

    /// Waits for the end and says how the stream ends.
    pub async fn wait(&mut self) -> Status {
        let closing = async {
            // An error means that the server is gone, and everything with it.
            let _ = self.closing.wait_for(|closing| *closing).await;
            Status::unavailable("the server is stopping")
        };
        match self.deadline {
            Some(deadline) => deadline.race(closing).await.unwrap_or_else(|late| late),
            None => closing.await,
        }
    }
}

#[cfg(test)]
mod tests {
    use tonic::codegen::http::{HeaderName, HeaderValue};

    use super::*;

    #[test]
    fn deadlines_are_read_or_ignored() {
        let read = |text: &str| {
            let value = HeaderValue::from_str(text).expect("a header");
            time_allowed(&HeaderMap::from_iter([(HeaderName::from_static(TIMEOUT), value)]))
        };
        assert_eq!(read("250m"), Some(Duration::from_millis(250)));
        assert_eq!(read("99999999H"), Some(Duration::from_secs(99_999_999 * 3600)));
        assert_eq!(read("0n"), Some(Duration::ZERO));
        for wrong in ["", "m", "12", "1x", "-1S", "+1S", "123456789S", "1 S"] {
            assert_eq!(read(wrong), None, "{wrong}");
        }
        assert_eq!(time_allowed(&HeaderMap::new()), None);
    }

    #[tokio::test]
    async fn a_stream_ends_by_its_deadline_or_with_the_server() {
        let (close, closing) = watch::channel(false);
        let mut request = Request::new(());
        let mut open = Ending::of(&request, closing.clone());
        let deadline = Deadline { at: Instant::now(), allowed: Duration::from_millis(3) };
        deadline.attach(request.extensions_mut());
        let late = Ending::of(&request, closing).wait().await;
        assert_eq!(late.code(), tonic::Code::DeadlineExceeded);
        assert!(late.message().contains("3ms"), "{late}");
        close.send_replace(true);
        assert_eq!(open.wait().await.code(), tonic::Code::Unavailable);
    }
}
