//! Frames in, acks out.

use std::num::NonZeroUsize;

use orenx::client::{Pace, load_ahead, send};
use orenx::dataset::synthetic::Synthetic;
use orenx::dataset::synthetic::truth::{Region, points};
use orenx::engine::QueuePolicy;
use orenx::map::{Fields, State};
use orenx::service::DEFAULT_MAP;
use orenx::wire::v1;
use orenx::wire::v1::{FrameReason, FrameStatus};

use super::{good_frame, open_stream, start, verdict};

#[tokio::test(flavor = "multi_thread")]
async fn a_room_streams_in_and_answers_as_it_is() {
    const FRAMES: usize = 60;
    let server = start(|_| {}).await;
    let room = std::sync::Arc::new(Synthetic::room(FRAMES).with_width(160));
    let pace = Pace {
        map_id: DEFAULT_MAP.into(),
        policy: QueuePolicy::Block,
        rate_hz: None,
        window: NonZeroUsize::new(4).unwrap(),
    };
    let source = load_ahead(room.clone(), 0..FRAMES, false, |_| {}).unwrap();
    let report = send(&server.client, pace, source, |_| {}).await.unwrap();
    assert_eq!((report.settled, report.integrated), (FRAMES as u64, FRAMES as u64));
    // An epoch may hold several frames.
    assert!((1..=FRAMES as u64).contains(&report.epoch), "epoch {}", report.epoch);

    let seen: Vec<usize> = (0..FRAMES).collect();
    let mut truth = points(&room, &seen, Region::Near { band_m: 0.08 }, 2000, 1);
    truth.retain(|t| t.closest_observed);
    let places: Vec<_> = truth.iter().map(|t| t.point).collect();
    let reply =
        server.client.query_points(DEFAULT_MAP, &places, Fields::ALL, report.epoch).await.unwrap();
    assert_eq!(reply.epoch, report.epoch);
    assert_eq!(reply.newest_stamp_ns, 33_333_333 * FRAMES as i64);
    let (mut known, mut right_side, mut errors) = (0, 0, Vec::new());
    for (i, truth) in truth.iter().enumerate() {
        let (state, distance) = (reply.answers.state[i], reply.answers.distance[i]);
        assert_eq!(state == State::Unknown as u8, distance.is_nan(), "{:?}", truth.point);
        if state != State::Unknown as u8 {
            known += 1;
            errors.push((distance - truth.distance).abs());
            let expected = if truth.distance < 0.0 { State::Occupied } else { State::Free };
            right_side += usize::from(state == expected as u8);
        }
    }
    errors.sort_by(f32::total_cmp);
    let median_m = errors[errors.len() / 2];
    // Images of 160×120 blur edges and thin things; most of the room is neither.
    assert!(known * 10 >= truth.len() * 9, "{known} of {} known", truth.len());
    assert!(right_side * 10 >= known * 9, "{right_side} of {known} on the right side");
    assert!(median_m < 0.01, "median error {median_m} m");

    let report = server.client.map_stats(DEFAULT_MAP).await.unwrap();
    assert_eq!((report.counts.received, report.counts.integrated), (60, 60));
    assert_eq!((report.stats.frames, report.counts.waiting), (60, 0));
    assert!(report.stats.map_bytes > 0 && report.resident_bytes > 0);
    let maps = server.client.list_maps().await.unwrap();
    assert_eq!(maps.len(), 1);
    assert_eq!((maps[0].map_id.as_str(), maps[0].epoch), (DEFAULT_MAP, report.summary.epoch));
    assert!(maps[0].bounds.size().min_element() > 2.0, "{:?}", maps[0].bounds);
    let (served, saved) = server.stop().await;
    served.unwrap();
    saved.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_frame_is_accepted_before_it_is_integrated() {
    let server = start(|_| {}).await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    frames.send(good_frame(5)).await.unwrap();
    let accepted = acks.message().await.unwrap().expect("an ack");
    assert_eq!((accepted.seq, accepted.status()), (5, FrameStatus::Accepted));
    assert_eq!((accepted.queue_depth, accepted.queue_capacity, accepted.credit), (1, 2, 1));
    let integrated = acks.message().await.unwrap().expect("an ack");
    assert_eq!((integrated.seq, integrated.status()), (5, FrameStatus::Integrated));
    assert_eq!(integrated.newest_stamp_ns, good_frame(5).stamp_ns);
    assert_eq!((integrated.queue_depth, integrated.credit), (0, 2));
    assert_eq!(
        (integrated.robot_id.as_str(), integrated.sensor_id.as_str()),
        ("recording", "rgbd")
    );
    drop(frames);
    assert!(acks.message().await.unwrap().is_none(), "the stream ends with its frames");
    server.stop().await.0.unwrap();
}

/// What a live sensor sends while the mapper is busy gives way to what it sends next, and is counted
/// where everyone can see it.
#[tokio::test(flavor = "multi_thread")]
async fn frames_that_gave_way_are_counted() {
    const FRAMES: u64 = 40;
    let server = start(|settings| settings.server.lane_frames = 1).await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    let sending = tokio::spawn(async move {
        for seq in 0..FRAMES {
            let mut frame = good_frame(seq);
            frame.set_queue_policy(v1::QueuePolicy::Latest);
            frames.send(frame).await.unwrap();
        }
    });
    let (mut integrated, mut dropped) = (0, 0);
    for _ in 0..FRAMES {
        let ack = verdict(&mut acks).await;
        match ack.status() {
            FrameStatus::Integrated => integrated += 1,
            FrameStatus::Dropped => {
                assert_eq!(ack.reason(), FrameReason::Replaced);
                dropped += 1;
            }
            _ => panic!("{ack:?}"),
        }
    }
    sending.await.unwrap();
    let report = server.client.map_stats(DEFAULT_MAP).await.unwrap();
    assert_eq!(report.counts.integrated, integrated);
    let counted: u64 = report.counts.dropped.iter().map(|(_, count)| count).sum();
    assert_eq!((report.counts.received, counted), (FRAMES, dropped));
    assert_eq!(report.stats.frames, integrated);
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_frame_without_depth_returns_is_accepted_and_counted() {
    let server = start(|_| {}).await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    let mut frame = good_frame(0);
    frame.depth.as_mut().unwrap().data.fill(0);
    frames.send(frame).await.unwrap();
    assert_eq!(verdict(&mut acks).await.status(), FrameStatus::Integrated);
    let stats = server.client.map_stats(DEFAULT_MAP).await.unwrap().stats;
    assert_eq!((stats.frames, stats.voxels), (1, 0));
    server.stop().await.0.unwrap();
}
