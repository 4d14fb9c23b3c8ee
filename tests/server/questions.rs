//! Questions and their answers, and those who do not wait for them.

use std::future::Future;

use glam::Vec3;
use orenx::map::Fields;
use orenx::service::DEFAULT_MAP;

use super::{good_frame, open_stream, start, verdict};

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
