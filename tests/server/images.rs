//! Images over gRPC: alone, in a stream, and those who do not wait for them.

use std::future::Future;

use orenx::config::Renderer;
use orenx::dataset::Dataset;
use orenx::dataset::synthetic::Synthetic;
use orenx::geometry::Intrinsics;
use orenx::map::{Camera, Encoding, Output};
use orenx::service::{ImageKind, ImageQuestion};
use orenx::wire::v1::FrameStatus;
use orenx::wire::{stream_image_question_to_wire, stream_image_reply_from_wire, v1};
use tokio::sync::mpsc;
use tokio_stream::StreamExt;
use tokio_stream::wrappers::ReceiverStream;

use super::{Running, good_frame, open_stream, start, verdict};

/// A server with a few frames of a room.
pub(crate) async fn mapped() -> Running {
    let server = start(|_| {}).await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    for seq in [0, 25, 50, 75] {
        frames.send(good_frame(seq)).await.unwrap();
        assert_eq!(verdict(&mut acks).await.status(), FrameStatus::Integrated);
    }
    server
}

/// The camera of one of those frames.
pub(crate) fn camera(seq: usize) -> Camera {
    let room = Synthetic::room(100).with_width(64);
    Camera { world_from_camera: room.pose(seq), intrinsics: room.intrinsics() }
}

/// Every output in every encoding that it has.
pub(crate) fn every_kind() -> Vec<ImageKind> {
    let encodings = [Encoding::Png, Encoding::Jpeg { quality: 70 }, Encoding::F32, Encoding::U8];
    let all = Output::ALL.iter().flat_map(|output| {
        encodings.iter().map(|encoding| ImageKind { output: *output, encoding: *encoding })
    });
    all.filter(|kind| kind.encoding.check(kind.output, "").is_ok()).collect()
}

fn numbers(bytes: &[u8]) -> Vec<f32> {
    bytes.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn an_image_shows_what_the_camera_saw_there() {
    let server = mapped().await;
    let truth = Synthetic::room(100).with_width(64).load(25, true).unwrap();
    let kind = |output| ImageKind { output, encoding: Encoding::F32 };
    let images = Output::ALL.map(kind).to_vec();
    for renderer in [Renderer::Tile, Renderer::Ray] {
        let question = ImageQuestion { renderer, ..ImageQuestion::new(camera(25), images.clone()) };
        let reply = server.client.render(&question).await.unwrap();
        assert_eq!((reply.width, reply.height, reply.epoch), (64, 48, 4));
        assert_eq!(reply.newest_stamp_ns, good_frame(75).stamp_ns);
        let [color, depth, normal, opacity, unknown] =
            [0, 1, 2, 3, 4].map(|i| numbers(&reply.images[i].1));
        let mut errors: Vec<f32> = depth
            .iter()
            .zip(&truth.depth.metres)
            .filter(|(z, true_z)| **z > 0.0 && **true_z > 0.0)
            .map(|(z, true_z)| (z - true_z).abs())
            .collect();
        errors.sort_by(f32::total_cmp);
        assert!(errors.len() * 10 > depth.len() * 8, "{} of {}", errors.len(), depth.len());
        assert!(errors[errors.len() / 2] < 0.05, "{renderer:?}: {}", errors[errors.len() / 2]);
        let true_color = &truth.color.as_ref().unwrap().rgb;
        // Four small images leave much of the room without a colour: black.
        let colored = color.chunks_exact(3).zip(true_color.chunks_exact(3));
        let off: Vec<f32> = colored
            .filter(|(ours, _)| ours.iter().any(|c| *c > 0.0))
            .flat_map(|(ours, truth)| {
                ours.iter().zip(truth).map(|(c, t)| (c - f32::from(*t) / 255.0).abs())
            })
            .collect();
        assert!(off.len() * 5 > color.len(), "{} of {} have a colour", off.len(), color.len());
        let mean = off.iter().sum::<f32>() / off.len() as f32;
        assert!(mean < 0.1, "{renderer:?}: colours are off by {mean}");
        for at in 0..depth.len() {
            let length = normal[3 * at..3 * at + 3].iter().map(|n| n * n).sum::<f32>().sqrt();
            let expected = if depth[at] > 0.0 { 1.0 } else { 0.0 };
            assert!((length - expected).abs() < 1e-3, "{renderer:?} {at}: a normal of {length}");
            assert!((0.0..=1.0).contains(&opacity[at]) && [0.0, 1.0].contains(&unknown[at]));
        }
    }
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stream_has_the_images_of_single_questions_in_order() {
    let server = mapped().await;
    let kinds = every_kind();
    let questions: Vec<ImageQuestion> = (0..7)
        .map(|i| ImageQuestion::new(camera(10 * i), kinds[2 * i..2 * i + 2].to_vec()))
        .collect();
    let messages: Vec<v1::RenderStreamRequest> =
        (50..).zip(&questions).map(|(id, q)| stream_image_question_to_wire(id, q)).collect();
    let mut client = v1::render_client::RenderClient::new(server.channel.clone());
    let replies = client.render_stream(tokio_stream::iter(messages)).await.unwrap();
    let replies: Vec<_> = replies.into_inner().collect::<Result<_, _>>().await.unwrap();
    assert_eq!(replies.len(), questions.len());
    for ((id, question), reply) in (50..).zip(&questions).zip(replies) {
        assert_eq!(reply.id, id);
        let reply = stream_image_reply_from_wire(reply, &question.images).unwrap().unwrap();
        let alone = server.client.render(question).await.unwrap();
        assert_eq!(reply.images, alone.images);
    }
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stream_ends_in_order_with_the_server() {
    let server = mapped().await;
    let (questions, outgoing) = mpsc::channel(8);
    let kinds = vec![ImageKind { output: Output::Color, encoding: Encoding::Png }];
    for id in 0..5 {
        let question = ImageQuestion::new(camera(id), kinds.clone());
        questions.send(stream_image_question_to_wire(id as u64, &question)).await.unwrap();
    }
    let mut client = v1::render_client::RenderClient::new(server.channel.clone());
    let mut replies =
        client.render_stream(ReceiverStream::new(outgoing)).await.unwrap().into_inner();
    assert_eq!(replies.message().await.unwrap().expect("an image").id, 0);
    let stopping = tokio::spawn(server.stop());
    let mut next = 1;
    let end = loop {
        match replies.message().await {
            Ok(Some(reply)) => {
                assert_eq!(reply.id, next);
                next += 1;
            }
            Ok(None) => panic!("it ends with a status"),
            Err(end) => break end,
        }
    };
    assert_eq!(end.code(), tonic::Code::Unavailable, "{end}");
    drop((questions, replies));
    let (served, saved) = stopping.await.unwrap();
    served.unwrap();
    saved.unwrap();
}

/// Whoever leaves takes their drawing along, so that the line moves on.
#[tokio::test(flavor = "multi_thread")]
async fn a_client_that_cancels_does_not_keep_others_waiting() {
    let server = mapped().await;
    let intrinsics =
        Intrinsics { fx: 900.0, fy: 900.0, cx: 999.5, cy: 999.5, width: 2000, height: 2000 };
    let large = Camera { intrinsics, ..camera(0) };
    let kinds = vec![ImageKind { output: Output::Color, encoding: Encoding::U8 }];
    let question = ImageQuestion::new(large, kinds.clone());
    for _ in 0..40 {
        let mut ask = Box::pin(server.client.render(&question));
        let polled = std::future::poll_fn(|context| {
            std::task::Poll::Ready(ask.as_mut().poll(context).is_pending())
        });
        assert!(polled.await, "no image comes at once");
        tokio::task::yield_now().await;
        drop(ask);
    }
    let reply = server.client.render(&ImageQuestion::new(camera(0), kinds)).await.unwrap();
    assert_eq!(reply.images[0].1.len(), 64 * 48 * 3);
    server.stop().await.0.unwrap();
}
