//! Questions in a stream, and what services say of themselves.

use glam::Vec3;
use orenx::map::Fields;
use orenx::service::{DEFAULT_MAP, PointsQuestion};
use orenx::wire::v1;
use tokio::sync::mpsc;
use tokio_stream::StreamExt;
use tokio_stream::wrappers::ReceiverStream;
use tonic_reflection::pb::v1::server_reflection_client::ServerReflectionClient;
use tonic_reflection::pb::v1::server_reflection_request::MessageRequest;
use tonic_reflection::pb::v1::server_reflection_response::MessageResponse;
use tonic_reflection::pb::{v1 as reflection, v1alpha};

use super::{good_frame, open_stream, start, verdict};

fn points(count: usize, from: f32) -> Vec<Vec3> {
    (0..count)
        .map(|i| {
            let share = i as f32 / count as f32;
            Vec3::new(
                6.0 * share - 3.0,
                (share * 91.0 + from).sin() * 2.0,
                (share * 37.0).cos() + 1.2,
            )
        })
        .collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn answers_come_in_order_and_are_those_of_single_questions() {
    let server = start(|_| {}).await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    for seq in [0, 25, 50] {
        frames.send(good_frame(seq)).await.unwrap();
        verdict(&mut acks).await;
    }
    // Small ones, which are answered at once, behind large ones, which are not; more than fit at a
    // time.
    let sizes: Vec<usize> = (0..30).map(|i| if i % 3 == 0 { 30_000 } else { i }).collect();
    let questions: Vec<(u64, PointsQuestion)> = sizes
        .iter()
        .zip(0..)
        .map(|(size, id)| (1000 - id, PointsQuestion::new(points(*size, id as f32))))
        .collect();
    let asked = tokio_stream::iter(questions.clone());
    let mut answers = server.client.stream_query(asked).await.unwrap();
    for (id, question) in &questions {
        let (answered, reply) = answers.next().await.unwrap().expect("an answer each");
        let (reply, alone) = (reply.unwrap(), server.client.ask(question).await.unwrap());
        assert_eq!((answered, reply.epoch), (*id, alone.epoch));
        let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(reply.answers.state, alone.answers.state);
        assert_eq!(bits(&reply.answers.distance), bits(&alone.answers.distance));
        assert_eq!(bits(&reply.answers.occupancy), bits(&alone.answers.occupancy));
    }
    assert!(answers.next().await.unwrap().is_none());
    server.stop().await.0.unwrap();
}

/// A question that is larger than what may be in flight still has its turn.
#[tokio::test(flavor = "multi_thread")]
async fn large_questions_have_the_stream_to_themselves() {
    let server = start(|_| {}).await;
    let questions: Vec<(u64, PointsQuestion)> =
        (0..4).map(|id| (id, PointsQuestion::new(vec![Vec3::ONE; 700_000]))).collect();
    let mut answers = server.client.stream_query(tokio_stream::iter(questions)).await.unwrap();
    for id in 0..4 {
        let (answered, reply) = answers.next().await.unwrap().expect("an answer each");
        assert_eq!((answered, reply.unwrap().answers.state.len()), (id, 700_000));
    }
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stream_ends_in_order_with_the_server() {
    let server = start(|_| {}).await;
    let (questions, outgoing) = mpsc::channel(8);
    let mut answers = server.client.stream_query(ReceiverStream::new(outgoing)).await.unwrap();
    for id in 0..5 {
        questions.send((id, PointsQuestion::new(points(5000, 0.0)))).await.unwrap();
    }
    // The first answer comes before the end, so that the stream is in the middle of its work.
    assert_eq!(answers.next().await.unwrap().expect("an answer").0, 0);
    let stopping = tokio::spawn(server.stop());
    let mut next = 1;
    let end = loop {
        match answers.next().await {
            Ok(Some((id, reply))) => {
                assert_eq!((id, reply.is_ok()), (next, true));
                next += 1;
            }
            Ok(None) => panic!("it ends with a status"),
            Err(end) => break end,
        }
    };
    assert_eq!(end.status(), orenx::error::Status::Unavailable, "{end}");
    drop((questions, answers));
    let (served, saved) = stopping.await.unwrap();
    served.unwrap();
    saved.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_reset_empties_what_a_stream_sees() {
    let server = start(|_| {}).await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    frames.send(good_frame(0)).await.unwrap();
    let epoch = verdict(&mut acks).await.epoch;
    let (questions, outgoing) = mpsc::channel(1);
    let mut answers = server.client.stream_query(ReceiverStream::new(outgoing)).await.unwrap();
    let mut question =
        PointsQuestion { fields: Fields::ALL, ..PointsQuestion::new(points(3000, 0.5)) };
    question.min_epoch = epoch;
    questions.send((1, question.clone())).await.unwrap();
    let (_, before) = answers.next().await.unwrap().expect("an answer");
    assert!(before.unwrap().answers.state.contains(&1));
    question.min_epoch = server.client.reset_map(DEFAULT_MAP).await.unwrap().epoch;
    questions.send((2, question)).await.unwrap();
    let (_, after) = answers.next().await.unwrap().expect("an answer");
    assert!(after.unwrap().answers.state.iter().all(|state| *state == 0));
    drop(questions);
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn reflection_tells_services_and_messages() {
    let server = start(|_| {}).await;
    let ask = |message_request| reflection::ServerReflectionRequest {
        host: String::new(),
        message_request: Some(message_request),
    };
    let questions = [
        ask(MessageRequest::ListServices(String::new())),
        ask(MessageRequest::FileContainingSymbol("orenx.v1.StreamQueryRequest".into())),
    ];
    let mut client = ServerReflectionClient::new(server.channel.clone());
    let replies = client.server_reflection_info(tokio_stream::iter(questions)).await.unwrap();
    let replies: Vec<_> = replies.into_inner().collect::<Result<_, _>>().await.unwrap();
    let [services, file] = &replies[..] else { panic!("{replies:?}") };
    let Some(MessageResponse::ListServicesResponse(list)) = &services.message_response else {
        panic!("{services:?}")
    };
    let names: Vec<&str> = list.service.iter().map(|service| service.name.as_str()).collect();
    let expected = ["orenx.v1.Ingest", "orenx.v1.Query", "orenx.v1.Render", "orenx.v1.Maps"];
    for name in expected.iter().chain(&["grpc.health.v1.Health"]) {
        assert!(names.contains(name), "{name} in {names:?}");
    }
    let Some(MessageResponse::FileDescriptorResponse(file)) = &file.message_response else {
        panic!("{file:?}")
    };
    assert!(!file.file_descriptor_proto.is_empty());

    let question = v1alpha::ServerReflectionRequest {
        host: String::new(),
        message_request: Some(v1alpha::server_reflection_request::MessageRequest::ListServices(
            String::new(),
        )),
    };
    let mut older =
        v1alpha::server_reflection_client::ServerReflectionClient::new(server.channel.clone());
    let replies = older.server_reflection_info(tokio_stream::once(question)).await.unwrap();
    assert!(replies.into_inner().message().await.unwrap().is_some());
    server.stop().await.0.unwrap();
}

/// Who holds an older description than this one is told so by numbers, not by guesses.
#[test]
fn reasons_have_the_same_names_on_the_wire_and_in_counters() {
    for reason in orenx::engine::Reason::ALL {
        let name = format!("FRAME_REASON_{}", reason.name().to_uppercase());
        assert!(v1::FrameReason::from_str_name(&name).is_some(), "{name}");
    }
}
