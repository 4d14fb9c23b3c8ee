//! Server-sent events: an answer that goes on for as long as its client reads.

use std::convert::Infallible;
use std::fmt::Display;
use std::pin::{Pin, pin};
use std::task::{Context, Poll};
use std::time::Duration;

use axum::body::Body;
use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use http_body::Frame;
use tokio::sync::mpsc;

use super::body::Share;
use super::refusal::Refusal;

/// The type of such an answer.
pub(super) const EVENTS: &str = "text/event-stream";
/// A stream without news says after this time that it is there, so that nothing on the way takes it
/// for dead, and a client that left is noticed.
const KEEPALIVE: Duration = Duration::from_secs(10);

/// An event, or a comment, and the memory that it takes until it has been sent.
pub(super) struct Event {
    bytes: Bytes,
    _share: Option<Share>,
}

/// What has events to tell.
pub(super) trait Source: Send + 'static {
    /// The next one; `None` after the last. It is asked for once there is room for it: who reads
    /// slowly gets what is new by then.
    fn next(&mut self) -> impl Future<Output = Result<Option<Event>, Refusal>> + Send;
}

impl Event {
    /// `data` is one line, as JSON is.
    pub(super) fn new(name: &str, id: impl Display, data: &[u8], share: Option<Share>) -> Self {
        let head = format!("event: {name}\nid: {id}\ndata: ");
        let bytes = [head.as_bytes(), data, b"\n\n"].concat();
        Self { bytes: bytes.into(), _share: share }
    }

    /// Why there are no more.
    fn refusal(refusal: &Refusal) -> Self {
        let bytes = [b"event: error\ndata: ", &refusal.json()[..], b"\n\n"].concat();
        Self { bytes: bytes.into(), _share: None }
    }

    fn keepalive() -> Self {
        Self { bytes: Bytes::from_static(b":\n\n"), _share: None }
    }
}

/// The answer that tells a source's events, one at a time, until it ends or nobody reads.
pub(super) fn respond(source: impl Source) -> Response {
    // One waits while one is sent.
    let (out, events) = mpsc::channel(1);
    tokio::spawn(tell(source, out, KEEPALIVE));
    let headers = [
        (header::CONTENT_TYPE, HeaderValue::from_static(EVENTS)),
        (header::CACHE_CONTROL, HeaderValue::from_static("no-store")),
    ];
    (headers, Body::new(Events { events, sent: None })).into_response()
}

async fn tell(mut source: impl Source, out: mpsc::Sender<Event>, keepalive: Duration) {
    loop {
        // Room first: what waits for a slow reader would be old when it is read.
        let Ok(mut room) = out.reserve().await else { return };
        let mut next = pin!(source.next());
        let next = loop {
            tokio::select! {
                next = &mut next => break next,
                () = tokio::time::sleep(keepalive) => room.send(Event::keepalive()),
                () = out.closed() => return,
            }
            match out.reserve().await {
                Ok(more) => room = more,
                Err(_) => return,
            }
        };
        match next {
            Ok(Some(event)) => room.send(event),
            Ok(None) => return,
            Err(refusal) => return room.send(Event::refusal(&refusal)),
        }
    }
}

struct Events {
    events: mpsc::Receiver<Event>,
    /// Its memory is kept until the next one is asked for.
    sent: Option<Event>,
}

impl http_body::Body for Events {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
        self.sent = None;
        self.events.poll_recv(context).map(|event| {
            self.sent = event;
            self.sent.as_ref().map(|event| Ok(Frame::data(event.bytes.clone())))
        })
    }
}

#[cfg(test)]
mod tests {
    use http_body_util::BodyExt;

    use super::*;
    use crate::error::Error;

    /// Tells what it is given, then an error.
    struct Told(mpsc::Receiver<u32>);

    impl Source for Told {
        async fn next(&mut self) -> Result<Option<Event>, Refusal> {
            match self.0.recv().await {
                Some(id) => Ok(Some(Event::new("news", id, b"{}", None))),
                None => Err(Error::Unavailable("no more".into()).into()),
            }
        }
    }

    #[tokio::test]
    async fn events_are_told_in_order_and_an_error_ends_them() {
        let (tell, told) = mpsc::channel(2);
        tell.send(7).await.expect("room");
        tell.send(8).await.expect("room");
        drop(tell);
        let response = respond(Told(told));
        assert_eq!(response.headers()[header::CONTENT_TYPE], EVENTS);
        let body = response.into_body().collect().await.expect("all of it");
        let text = String::from_utf8(body.to_bytes().to_vec()).expect("text");
        let news = "event: news\nid: 7\ndata: {}\n\nevent: news\nid: 8\ndata: {}\n\n";
        let end = "event: error\ndata: {\"error\":{\"code\":\"UNAVAILABLE\"";
        assert!(text.starts_with(&format!("{news}{end}")) && text.ends_with("}\n\n"), "{text}");
    }

    #[tokio::test]
    async fn silence_is_filled_with_comments_until_there_is_news() {
        let (news, told) = mpsc::channel(1);
        let (out, mut events) = mpsc::channel(1);
        let telling = tokio::spawn(tell(Told(told), out, Duration::from_millis(1)));
        for _ in 0..3 {
            assert_eq!(events.recv().await.expect("a comment").bytes, ":\n\n");
        }
        news.send(1).await.expect("room");
        let mut event = events.recv().await.expect("more");
        while event.bytes == ":\n\n" {
            event = events.recv().await.expect("more");
        }
        assert!(event.bytes.starts_with(b"event: news"));
        // Who leaves while nothing is new ends the telling.
        drop(events);
        telling.await.expect("no panic");
    }
}
