//! Robots and planners at once, and the same numbers on every transport.

use std::num::NonZeroUsize;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use glam::Vec3;
use orenx::client::{HttpClient, Pace, Questioner, StreamReport, ZenohClient, load_ahead, send};
use orenx::dataset::Dataset;
use orenx::dataset::synthetic::Synthetic;
use orenx::engine::QueuePolicy;
use orenx::map::{Fields, PointAnswers};
use orenx::service::{DEFAULT_MAP, PointsQuestion};
use orenx::wire::v1::FrameStatus;
use tokio::sync::mpsc;
use zenoh::sample::Sample;

use super::router::Router;
use super::{Robot, start_on};
use crate::server::{good_frame, open_stream, verdict};

const FRAMES: usize = 12;

async fn stream(url: String, name: &'static str) -> StreamReport {
    let client = ZenohClient::connect(&url).await.unwrap();
    let room: Arc<dyn Dataset> = Arc::new(Synthetic::room(100).with_width(64));
    let rename = move |frame: &mut orenx::frame::Frame| frame.robot_id = name.into();
    let frames = load_ahead(room, (0..FRAMES).map(|i| i * 8), false, rename).unwrap();
    let pace = Pace {
        map_id: DEFAULT_MAP.into(),
        policy: QueuePolicy::Block,
        rate_hz: None,
        window: NonZeroUsize::new(4).unwrap(),
    };
    send(&client, pace, frames, |_| {}).await.unwrap()
}

/// Asks again and again until the robots are done; the last epoch that answered.
async fn plan(url: String, is_done: Arc<AtomicBool>) -> u64 {
    let client = Questioner::connect(&url).await.unwrap();
    let mut question = PointsQuestion::new(points());
    loop {
        let last_turn = is_done.load(Relaxed);
        let reply = client.ask(&question).await.unwrap();
        assert!(reply.epoch >= question.min_epoch, "time goes one way");
        assert_eq!(reply.answers.state.len(), question.points.len());
        question.min_epoch = reply.epoch;
        if last_turn {
            return reply.epoch;
        }
    }
}

/// More than are answered in place.
fn points() -> Vec<Vec3> {
    let at = |i: u32| i as f32 / 5000.0;
    let point = |t: f32| Vec3::new(6.0 * t - 3.0, (t * 91.0).sin() * 2.0, (t * 37.0).cos() + 1.2);
    (0..5000).map(|i| point(at(i))).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn two_robots_stream_into_one_map_while_four_planners_ask() {
    let router = Router::start();
    let (server, client) = start_on(&router, |_| {}).await;
    let is_done = Arc::new(AtomicBool::new(false));
    let urls = [router.url(), server.url.clone(), router.url(), server.url.clone()];
    let planners = urls.map(|url| tokio::spawn(plan(url, is_done.clone())));
    let robots = ["ada", "bob"].map(|name| tokio::spawn(stream(router.url(), name)));
    let mut newest = 0;
    for robot in robots {
        let report = robot.await.unwrap();
        // An ack may get lost where a frame may not.
        let told = report.integrated + report.unanswered;
        assert_eq!((told, report.settled), (FRAMES as u64, FRAMES as u64), "{report:?}");
        newest = newest.max(report.epoch);
    }
    is_done.store(true, Relaxed);
    for planner in planners {
        assert!(planner.await.unwrap() >= newest, "what was integrated is seen by all");
    }
    let counts = client.map_stats(DEFAULT_MAP).await.unwrap().counts;
    assert_eq!((counts.integrated, counts.lost), (2 * FRAMES as u64, 0), "{counts:?}");
    drop(client);
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn every_transport_says_the_same_numbers() {
    let router = Router::start();
    let (server, zenoh) = start_on(&router, |_| {}).await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    for seq in [0, 25, 50, 75] {
        frames.send(good_frame(seq)).await.unwrap();
        assert_eq!(verdict(&mut acks).await.status(), FrameStatus::Integrated);
    }
    let http = HttpClient::new(&format!("http://{}", server.http)).unwrap();
    let question = PointsQuestion {
        fields: Fields { text_score: false, ..Fields::ALL },
        ..PointsQuestion::new(points())
    };
    let replies = [
        server.client.ask(&question).await.unwrap(),
        http.ask(&question).await.unwrap(),
        zenoh.ask(&question).await.unwrap(),
    ];
    let [grpc, others @ ..] = &replies;
    assert!(grpc.answers.distance.iter().filter(|d| d.is_finite()).count() > 100);
    for other in others {
        assert_eq!((grpc.epoch, grpc.newest_stamp_ns), (other.epoch, other.newest_stamp_ns));
        assert_eq!(bits(&grpc.answers), bits(&other.answers));
        assert_eq!(grpc.answers.state, other.answers.state);
    }
    drop((zenoh, frames, acks));
    server.stop().await.0.unwrap();
}

/// NaN is an answer too.
fn bits(answers: &PointAnswers) -> [Vec<u32>; 4] {
    let all = |numbers: &[f32]| numbers.iter().map(|n| n.to_bits()).collect::<Vec<_>>();
    [
        all(&answers.distance),
        all(bytemuck::cast_slice(&answers.gradient)),
        all(&answers.occupancy),
        all(bytemuck::cast_slice(&answers.color)),
    ]
}

#[tokio::test(flavor = "multi_thread")]
async fn a_subscriber_that_does_not_read_slows_nobody() {
    let router = Router::start();
    let (server, client) = start_on(&router, |s| s.bus.status_interval_ms = 10).await;
    // It takes one sample and is stuck with it until the end.
    let slow = ZenohClient::connect(&router.url()).await.unwrap();
    let (stuck, is_stuck) = tokio::sync::oneshot::channel();
    let (release, released) = std::sync::mpsc::channel::<()>();
    let (stuck, released) = (std::sync::Mutex::new(Some(stuck)), std::sync::Mutex::new(released));
    let subscriber = slow
        .bus()
        .session()
        .declare_subscriber("orenx/**")
        .callback(move |_: Sample| {
            if let Some(stuck) = stuck.lock().unwrap().take() {
                stuck.send(()).unwrap();
                let _ = released.lock().unwrap().recv();
            }
        })
        .await
        .unwrap();
    is_stuck.await.unwrap();
    let mut robot = Robot::connect(&router.url(), "ada").await;
    for seq in 0..FRAMES as u64 {
        robot.put(seq).await;
        assert_eq!(robot.verdict().await.status(), FrameStatus::Integrated);
        client.ask(&PointsQuestion::new(points())).await.unwrap();
    }
    drop(release);
    drop((subscriber, slow, client, robot));
    server.stop().await.0.unwrap();
}

/// Frames of a live robot that come faster than they are taken give way to newer ones, each with its
/// verdict.
#[tokio::test(flavor = "multi_thread")]
async fn a_robot_that_is_too_fast_gets_a_verdict_for_each_frame() {
    const BURST: u64 = 40;
    let router = Router::start();
    let (server, client) = start_on(&router, |_| {}).await;
    let mut robot = Robot::connect(&router.url(), "ada").await;
    for seq in 0..BURST {
        let mut frame = good_frame(seq);
        (frame.robot_id, frame.queue_policy) = ("ada".into(), 0);
        frame.sensor_id = "front".into();
        robot.put_message(&frame).await;
    }
    let mut verdicts = Vec::new();
    for _ in 0..BURST {
        verdicts.push(robot.verdict().await);
    }
    let newest = verdicts.iter().find(|ack| ack.seq == BURST - 1).expect("the last one");
    assert_eq!(newest.status(), FrameStatus::Integrated, "nothing is newer");
    let allowed = [FrameStatus::Integrated, FrameStatus::Dropped];
    assert!(verdicts.iter().all(|ack| allowed.contains(&ack.status())), "{verdicts:?}");
    let counts = client.map_stats(DEFAULT_MAP).await.unwrap().counts;
    assert_eq!((counts.received, counts.lost), (BURST, 0), "{counts:?}");
    drop((client, robot));
    server.stop().await.0.unwrap();
}

/// Hears everything that is said about one key, for the tests of what the server says unasked.
pub(super) async fn listen(client: &ZenohClient, key: &str) -> mpsc::UnboundedReceiver<Sample> {
    let (told, samples) = mpsc::unbounded_channel();
    client
        .bus()
        .session()
        .declare_subscriber(key.to_owned())
        .callback(move |sample| {
            let _ = told.send(sample);
        })
        .background()
        .await
        .unwrap();
    samples
}
