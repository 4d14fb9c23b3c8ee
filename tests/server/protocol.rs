//! What is wrong below the messages: bytes that are none, clients that leave.

use std::future::Future;

use glam::Vec3;
use orenx::map::Fields;
use orenx::service::DEFAULT_MAP;
use orenx::wire::v1;
use tonic::client::Grpc;
use tonic::codec::{Codec, DecodeBuf, Decoder, EncodeBuf, Encoder};
use tonic::codegen::http::uri::PathAndQuery;
use tonic::{Code, Request, Status};
use tonic_prost::prost::bytes::{Buf, BufMut};

use super::{good_frame, open_stream, start, verdict};

/// Sends bytes as they are, whatever they are, and drops what comes back.
#[derive(Default)]
struct Raw;

impl Codec for Raw {
    type Encode = &'static [u8];
    type Decode = ();
    type Encoder = Self;
    type Decoder = Self;

    fn encoder(&mut self) -> Self {
        Self
    }

    fn decoder(&mut self) -> Self {
        Self
    }
}

impl Encoder for Raw {
    type Item = &'static [u8];
    type Error = Status;

    fn encode(&mut self, bytes: &'static [u8], to: &mut EncodeBuf<'_>) -> Result<(), Status> {
        to.put(bytes);
        Ok(())
    }
}

impl Decoder for Raw {
    type Item = ();
    type Error = Status;

    fn decode(&mut self, bytes: &mut DecodeBuf<'_>) -> Result<Option<()>, Status> {
        bytes.advance(bytes.remaining());
        Ok(Some(()))
    }
}

/// Ends before its own length; a field of wire type 7; a varint without an end; text.
const GARBAGE: [&[u8]; 4] = [&[0x0a, 0x7f, b'x'], &[0x0f, 0x01], &[0x80; 11], b"GET / HTTP/1.1"];

#[tokio::test(flavor = "multi_thread")]
async fn bytes_that_are_no_message_are_refused_and_the_server_goes_on() {
    let server = start(|_| {}).await;
    for bytes in GARBAGE {
        for path in ["/orenx.v1.Query/QueryPoints", "/orenx.v1.Maps/GetMapStats"] {
            let mut client = Grpc::new(server.channel.clone());
            client.ready().await.unwrap();
            let path = PathAndQuery::from_static(path);
            let status =
                client.unary(Request::new(bytes), path, Raw).await.expect_err("no message");
            assert_eq!(status.code(), Code::InvalidArgument, "{bytes:?}: {status:?}");
            assert!(status.message().contains("no valid protobuf"), "{}", status.message());
        }
        let mut client = Grpc::new(server.channel.clone());
        client.ready().await.unwrap();
        let path = PathAndQuery::from_static("/orenx.v1.Ingest/StreamFrames");
        let frames = tokio_stream::once(bytes);
        let answer = client.streaming(Request::new(frames), path, Raw).await;
        let status = match answer {
            Ok(acks) => acks.into_inner().message().await.expect_err("no frame"),
            Err(status) => status,
        };
        assert_eq!(status.code(), Code::InvalidArgument, "{bytes:?}: {status:?}");
    }
    let (frames, mut acks) = open_stream(&server.channel).await;
    frames.send(good_frame(0)).await.unwrap();
    assert_eq!(verdict(&mut acks).await.status(), v1::FrameStatus::Integrated);
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_that_cancels_does_not_keep_others_waiting() {
    let server = start(|settings| settings.server.max_points = 100_000).await;
    let points = vec![Vec3::ONE; 100_000];
    for _ in 0..10 {
        let ask = server.client.query_points(DEFAULT_MAP, &points, Fields::ALL, 0);
        let mut ask = Box::pin(ask);
        // Sent, and left before the answer.
        let polled = std::future::poll_fn(|context| {
            std::task::Poll::Ready(ask.as_mut().poll(context).is_pending())
        });
        assert!(polled.await, "no answer comes at once");
        tokio::task::yield_now().await;
        drop(ask);
    }
    let reply = server.client.query_points(DEFAULT_MAP, &points, Fields::ALL, 0).await.unwrap();
    assert_eq!(reply.answers.state.len(), points.len());
    server.stop().await.0.unwrap();
}
