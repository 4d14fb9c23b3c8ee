//! Clients that leave in the middle, and clients that never listen.

use orenx::client::Client;
use orenx::service::DEFAULT_MAP;
use orenx::wire::v1;
use orenx::wire::v1::FrameStatus;
use orenx::wire::v1::stream_query_request::Question;
use tokio::io::AsyncWriteExt;

use super::super::{good_frame, open_stream, start, verdict};
use super::well;
use super::wire::{begin, question, sent};

#[tokio::test(flavor = "multi_thread")]
async fn a_client_that_dies_leaves_the_server_well() {
    let server = start(|_| {}).await;
    // In the middle of a stream: frames are sent, acks are never read.
    let (frames, acks) = open_stream(&server.channel).await;
    for seq in 0..3 {
        frames.send(good_frame(seq)).await.unwrap();
    }
    drop((frames, acks));
    // In the middle of the handshake.
    let address = server.url.strip_prefix("http://").unwrap();
    for half in ["PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\u{12}\u{4}\0\0", "GET / HT"] {
        let mut socket = tokio::net::TcpStream::connect(address).await.unwrap();
        socket.write_all(half.as_bytes()).await.unwrap();
    }
    // In the middle of a frame, and of a question.
    let frame = sent(&good_frame(0));
    let asked = sent(&question(DEFAULT_MAP, 50_000));
    for (path, whole) in [
        ("/orenx.v1.Ingest/StreamFrames", frame),
        ("/orenx.v1.Query/QueryPoints", asked.clone()),
        ("/orenx.v1.Query/StreamQuery", asked),
    ] {
        let mut call = begin(&server.url, path, None, 65_535).await;
        call.request.send_data(whole.slice(..whole.len() / 2), false).unwrap();
        well(&server).await;
        call.die();
        well(&server).await;
    }
    let other = Client::connect(&server.url).await.unwrap();
    let (frames, mut acks) = open_stream(&server.channel).await;
    frames.send(good_frame(7)).await.unwrap();
    assert_eq!(verdict(&mut acks).await.status(), FrameStatus::Integrated);
    assert_eq!(other.list_maps().await.unwrap().len(), 1);
    let counts = well(&server).await;
    assert!((1..=4).contains(&counts.received), "half a frame is none: {counts:?}");
    let (served, saved) = server.stop().await;
    served.unwrap();
    saved.unwrap();
}

/// With a window of 0 the server cannot send a byte of its answers.
#[tokio::test(flavor = "multi_thread")]
async fn acks_that_nobody_reads_stop_the_frames() {
    const SENT: u64 = 300;
    /// Two acks a frame fill the server's queue, and the transport may hold as many again.
    const BOUNDS: std::ops::RangeInclusive<u64> = 64..=128;
    let server = start(|_| {}).await;
    let mut call = begin(&server.url, "/orenx.v1.Ingest/StreamFrames", None, 0).await;
    let good = good_frame(0);
    for seq in 0..SENT {
        let frame = v1::Frame { seq, ..good.clone() };
        call.request.send_data(sent(&frame), false).unwrap();
    }
    // As many as the server takes, until it has taken no more for a while.
    let (mut received, mut well_since) = (0, 0);
    while received < *BOUNDS.start() || well_since < 50 {
        let now = well(&server).await.received;
        well_since = if now == received { well_since + 1 } else { 0 };
        received = now;
    }
    assert!(BOUNDS.contains(&received), "{received} of {SENT}");
    drop(call);
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn answers_that_nobody_reads_stop_the_questions() {
    /// Of 10 000 points.
    const QUESTION: usize = 120_000;
    /// The server's window for one stream, 8 questions in flight, and one between.
    const BOUND: usize = (4 << 20) + 10 * (QUESTION + 100);
    let server = start(|_| {}).await;
    let mut call = begin(&server.url, "/orenx.v1.Query/StreamQuery", None, 0).await;
    let question = Some(Question::Points(question(DEFAULT_MAP, 10_000)));
    let message = sent(&v1::StreamQueryRequest { id: 1, question });
    let mut taken = 0;
    let mut well_since = 0;
    // As much as the server takes, until it has taken no more for a while.
    while well_since < 50 {
        call.request.reserve_capacity(message.len());
        let granted = std::future::poll_fn(|context| {
            std::task::Poll::Ready(match call.request.poll_capacity(context) {
                std::task::Poll::Ready(granted) => granted.unwrap().unwrap(),
                std::task::Poll::Pending => call.request.capacity(),
            })
        })
        .await;
        if granted == message.len() {
            call.request.send_data(message.clone(), false).unwrap();
            taken += message.len();
            well_since = 0;
        } else {
            well(&server).await;
            well_since += 1;
        }
        assert!(taken <= BOUND, "{taken} bytes of questions");
    }
    assert!(taken + message.len() > 4 << 20, "the window at least: {taken}");
    drop(call);
    server.stop().await.0.unwrap();
}
