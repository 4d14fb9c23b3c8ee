//! Questions with one field wrong in turn, alone and in a stream.

use orenx::service::DEFAULT_MAP;
use orenx::wire::v1;
use orenx::wire::v1::stream_query_reply::Answer;
use orenx::wire::v1::stream_query_request::Question;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::Code;

use super::super::start;
use super::{ended, well};

const PATH: &str = "/orenx.v1.Query/QueryPoints";

/// What is wrong with a question, the code of its refusal, the field, and what is said.
type Fault = (fn(&mut v1::QueryPointsRequest), Code, &'static str, &'static [&'static str]);

const FAULTS: &[Fault] = {
    use Code::{FailedPrecondition, InvalidArgument, NotFound};
    &[
        (|q| q.map_id.clear(), InvalidArgument, "map_id", &["default"]),
        (|q| q.map_id = "attic".into(), NotFound, "", &["map_id", "attic"]),
        (|q| q.points_m.truncate(4), InvalidArgument, "points_m", &["4 numbers", "x, y, z"]),
        (|q| q.points_m[4] = f32::NAN, InvalidArgument, "points_m[1].y", &["NaN", "finite"]),
        (|q| q.points_m[0] = f32::INFINITY, InvalidArgument, "points_m[0].x", &["inf", "finite"]),
        (
            |q| q.points_m = vec![0.0; 3003],
            InvalidArgument,
            "points_m",
            &["1001", "1000", "max_points"],
        ),
        (|q| q.fields = vec![1, 77], InvalidArgument, "fields[1]", &["77", "GRADIENT"]),
        (|q| q.fields = vec![0], InvalidArgument, "fields[0]", &["0", "STATE"]),
        (|q| q.min_epoch = 1, FailedPrecondition, "", &["min_epoch", "1", "newest is 0"]),
        (|q| q.min_epoch = u64::MAX, FailedPrecondition, "", &["min_epoch", "newest is 0"]),
        (|q| q.max_age_ms = 50, FailedPrecondition, "", &["max_age_ms", "no frame", "50"]),
        (
            |q| q.unknown_policy = 3,
            InvalidArgument,
            "unknown_policy",
            &["3", "REPORT, FREE, OCCUPIED"],
        ),
        (|q| q.unknown_distance_m = Some(1.0), InvalidArgument, "unknown_distance_m", &["REPORT"]),
        (
            |q| {
                q.unknown_policy = 1;
                q.unknown_distance_m = Some(-1.0);
            },
            InvalidArgument,
            "unknown_distance_m",
            &["-1", "(0, 10000]"],
        ),
        (|q| q.frame_id = "odom".into(), InvalidArgument, "frame_id", &["odom", "'map'"]),
    ]
};

fn good() -> v1::QueryPointsRequest {
    v1::QueryPointsRequest {
        map_id: DEFAULT_MAP.into(),
        points_m: vec![0.5; 6],
        frame_id: "map".into(),
        ..v1::QueryPointsRequest::default()
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn each_is_refused_by_name_alone_and_in_a_stream() {
    let server = start(|settings| settings.server.max_points = 1000).await;
    let mut client = v1::query_client::QueryClient::new(server.channel.clone());
    let (questions, outgoing) = mpsc::channel(1);
    let mut answers =
        client.stream_query(ReceiverStream::new(outgoing)).await.unwrap().into_inner();
    for (id, (spoil, code, field, words)) in (1..).zip(FAULTS) {
        let mut question = good();
        spoil(&mut question);
        let before = ended(&server, PATH, *code).await;
        let status = client.query_points(question.clone()).await.expect_err(words[0]);
        assert_eq!(ended(&server, PATH, *code).await, before + 1.0, "{field}");
        assert_eq!(status.code(), *code, "{}", status.message());
        assert!(status.message().starts_with(field), "{field}: {}", status.message());
        for word in *words {
            assert!(status.message().contains(word), "{word} in: {}", status.message());
        }

        let question = Some(Question::Points(question));
        questions.send(v1::StreamQueryRequest { id, question }).await.unwrap();
        let reply = answers.message().await.unwrap().expect("a reply");
        let Some(Answer::Error(error)) = reply.answer else { panic!("{reply:?}") };
        assert_eq!((reply.id, error.code), (id, i32::from(*code) as u32));
        assert_eq!((error.field.as_str(), error.message.as_str()), (*field, status.message()));
        well(&server).await;
    }
    let nothing = v1::StreamQueryRequest { id: 99, question: None };
    questions.send(nothing).await.unwrap();
    let reply = answers.message().await.unwrap().expect("a reply");
    assert!(matches!(reply.answer, Some(Answer::Error(e)) if e.field == "question"));

    // The stream goes on.
    let question = Some(Question::Points(good()));
    questions.send(v1::StreamQueryRequest { id: 100, question }).await.unwrap();
    let reply = answers.message().await.unwrap().expect("a reply");
    assert_eq!(reply.id, 100);
    assert!(matches!(reply.answer, Some(Answer::Points(points)) if points.state == [0, 0]));
    drop(questions);
    assert!(answers.message().await.unwrap().is_none(), "it ends with its questions");
    server.stop().await.0.unwrap();
}
