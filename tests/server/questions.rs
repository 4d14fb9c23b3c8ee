//! Questions and their refusals.

use glam::Vec3;
use orenx::error::Status;
use orenx::map::Fields;
use orenx::service::DEFAULT_MAP;
use orenx::wire::v1;
use tonic::Code;

use super::{good_frame, open_stream, start, verdict};

/// A question, the code of its refusal and what the refusal must say.
type Refusal = (v1::QueryPointsRequest, Code, &'static [&'static str]);

fn ask(map_id: &str, points_m: &[f32]) -> v1::QueryPointsRequest {
    v1::QueryPointsRequest {
        map_id: map_id.into(),
        points_m: points_m.to_vec(),
        ..v1::QueryPointsRequest::default()
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn bad_questions_are_refused_by_name() {
    let server = start(|settings| settings.server.max_points = 1000).await;
    let many = vec![0.0; 3 * 1001];
    let late = v1::QueryPointsRequest { min_epoch: 1, ..ask(DEFAULT_MAP, &[0.0; 3]) };
    let field = v1::QueryPointsRequest { fields: vec![1, 77], ..ask(DEFAULT_MAP, &[0.0; 3]) };
    let huge = vec![0.0; 17 << 20];
    let refusals: [Refusal; 8] = [
        (ask("", &[0.0; 3]), Code::InvalidArgument, &["map_id", "default"]),
        (ask("attic", &[0.0; 3]), Code::NotFound, &["map_id", "attic"]),
        (ask(DEFAULT_MAP, &[0.0; 4]), Code::InvalidArgument, &["points_m", "4"]),
        (
            ask(DEFAULT_MAP, &[0.0, 0.0, 0.0, 0.0, f32::NAN, 0.0]),
            Code::InvalidArgument,
            &["points_m[1].y", "NaN", "finite"],
        ),
        (ask(DEFAULT_MAP, &many), Code::InvalidArgument, &["points_m", "1001", "1000"]),
        (field, Code::InvalidArgument, &["fields[1]", "77", "GRADIENT"]),
        (late, Code::FailedPrecondition, &["min_epoch", "1", "0"]),
        (ask(DEFAULT_MAP, &huge), Code::OutOfRange, &["67108864"]),
    ];
    let mut client = v1::query_client::QueryClient::new(server.channel.clone());
    for (question, code, words) in refusals {
        let status = client.query_points(question).await.expect_err(words[0]);
        assert_eq!(status.code(), code, "{}", status.message());
        for word in words {
            assert!(status.message().contains(word), "{word} in: {}", status.message());
        }
    }
    let unknown = server.client.map_stats("attic").await.expect_err("no such map");
    assert_eq!(unknown.status(), Status::NotFound);
    let reply = client.query_points(ask(DEFAULT_MAP, &[0.5, 0.5, 0.5])).await.unwrap();
    assert_eq!(reply.into_inner().state, [0]);
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn only_the_columns_that_were_asked_for_come_back() {
    let server = start(|_| {}).await;
    let points = [Vec3::ZERO, Vec3::ONE];
    let reply =
        server.client.query_points(DEFAULT_MAP, &points, Fields::DISTANCE, 0).await.unwrap();
    assert_eq!(reply.answers.distance.len(), 2);
    assert!(reply.answers.distance.iter().all(|d| d.is_nan()));
    assert!(reply.answers.gradient.is_empty() && reply.answers.state.is_empty());
    let none = server.client.query_points(DEFAULT_MAP, &[], Fields::ALL, 0).await.unwrap();
    assert!(none.answers.distance.is_empty());
    server.stop().await.0.unwrap();
}

/// Small questions are answered where they arrive, large ones in chunks on other threads.
#[tokio::test(flavor = "multi_thread")]
async fn a_large_question_has_the_answers_of_small_ones() {
    let server = start(|_| {}).await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    for seq in [0, 25, 50, 75] {
        frames.send(good_frame(seq)).await.unwrap();
    }
    let mut epoch = 0;
    for _ in 0..4 {
        epoch = verdict(&mut acks).await.epoch;
    }
    let points: Vec<Vec3> = (0..20_011u16)
        .map(|i| {
            let share = f32::from(i) / 20_011.0;
            Vec3::new(6.0 * share - 3.0, (share * 91.0).sin() * 2.0, (share * 37.0).cos() + 1.2)
        })
        .collect();
    let large = server.client.query_points(DEFAULT_MAP, &points, Fields::ALL, epoch).await.unwrap();
    assert_eq!(large.epoch, epoch);
    assert!(large.answers.state.contains(&1) && large.answers.state.contains(&0));
    let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    for (index, piece) in points.chunks(2000).enumerate() {
        let small =
            server.client.query_points(DEFAULT_MAP, piece, Fields::ALL, epoch).await.unwrap();
        let range = index * 2000..index * 2000 + piece.len();
        assert_eq!(small.answers.state, large.answers.state[range.clone()]);
        assert_eq!(bits(&small.answers.distance), bits(&large.answers.distance[range.clone()]));
        assert_eq!(bits(&small.answers.occupancy), bits(&large.answers.occupancy[range]));
    }
    server.stop().await.0.unwrap();
}
