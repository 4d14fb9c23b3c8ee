//! What is watched over Zenoh: begun by a question, told to a key, ended with its last subscriber.

use std::collections::BTreeMap;

use orenx::bus::{Slices, encoding_of};
use orenx::client::ZenohClient;
use orenx::service::DEFAULT_MAP;
use orenx::wire::v1::planner_client::PlannerClient;
use orenx::wire::{read_message, v1};
use prost::Message;
use tokio::sync::mpsc;
use zenoh::pubsub::Subscriber;
use zenoh::sample::{Sample, SampleKind};

use super::router::Router;
use super::start_on;
use super::verbs::{ask, refusal};
use crate::server::planner::{FRAMES, send};

fn corner(x: f64, y: f64, z: f64) -> Option<v1::Vector3> {
    Some(v1::Vector3 { x, y, z })
}

fn region() -> v1::WatchRegionRequest {
    v1::WatchRegionRequest {
        region: Some(v1::Aabb { min: corner(-2.0, -1.6, 0.4), max: corner(2.0, 1.6, 1.4) }),
        voxel_m: 0.2,
        min_interval_ms: 1,
        tolerance_m: 0.01,
        ..v1::WatchRegionRequest::default()
    }
}

/// Through a wall.
fn way() -> v1::WatchTrajectoryRequest {
    let pose = |x: f32| [x, 0.9, 1.3, 0.0, 0.0, 0.0, 1.0];
    let check = v1::CheckTrajectoriesRequest {
        spheres_m: vec![0.0, 0.0, 0.0, 0.1],
        poses: [pose(0.0), pose(4.0)].concat(),
        swept: true,
        ..v1::CheckTrajectoriesRequest::default()
    };
    v1::WatchTrajectoryRequest { check: Some(check), drop_m: 0.0 }
}

/// All that is said on a key.
async fn hear(client: &ZenohClient, key: &str) -> (mpsc::Receiver<Sample>, Subscriber<()>) {
    let (tell, told) = mpsc::channel(1024);
    let subscriber = client
        .bus()
        .session()
        .declare_subscriber(key.to_owned())
        .callback(move |sample: Sample| tell.try_send(sample).unwrap())
        .await
        .unwrap();
    (told, subscriber)
}

fn message<M: Message + Default>(sample: &Sample, kind: &str) -> M {
    assert_eq!(*sample.encoding(), encoding_of(kind));
    read_message(Slices::of(sample.payload())).unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn watches_tell_their_subscribers_what_is_new() {
    let router = Router::start();
    let (server, client) = start_on(&router, |s| s.bus.status_interval_ms = 10).await;
    let begun: v1::WatchReply = ask(&client, "watch_region", &region()).await;
    assert_eq!(begun.key, format!("orenx/{DEFAULT_MAP}/out/watch/{}", begun.id));
    let (mut bricks, _bricks) = hear(&client, &begun.key).await;
    let begun: v1::WatchReply = ask(&client, "watch_trajectories", &way()).await;
    let (mut ways, watching) = hear(&client, &begun.key).await;
    let first: v1::WatchTrajectoryReply =
        message(&ways.recv().await.unwrap(), "WatchTrajectoryReply");
    assert_eq!(first.seq, 1);
    assert!(first.result.unwrap().trajectories[0].first_hit.is_none(), "nothing is mapped yet");

    let epoch = send(&server, 0..FRAMES).await;
    let second: v1::WatchTrajectoryReply =
        message(&ways.recv().await.unwrap(), "WatchTrajectoryReply");
    assert_eq!(second.seq, 2);
    assert!(second.result.unwrap().trajectories[0].first_hit.is_some(), "the wall");
    // What is told adds up to what another watch begins with.
    let map_id = DEFAULT_MAP.to_owned();
    let whole = v1::WatchRegionRequest { map_id, ..region() };
    let mut planner = PlannerClient::new(server.channel.clone());
    let mut news = planner.watch_region(whole).await.unwrap().into_inner();
    let whole = news.message().await.unwrap().unwrap();
    assert!(whole.epoch >= epoch && whole.bricks.len() > 2);
    let states = |bricks: Vec<v1::RegionBrick>| {
        bricks.into_iter().map(|brick| ((brick.z, brick.y, brick.x), brick.state))
    };
    let expected = BTreeMap::from_iter(states(whole.bricks));
    let (mut told, mut seq) = (BTreeMap::new(), 0);
    while told != expected {
        let change: v1::WatchRegionReply =
            message(&bricks.recv().await.unwrap(), "WatchRegionReply");
        seq += 1;
        assert_eq!((change.seq, &change.size), (seq, &whole.size), "none is lost");
        told.extend(states(change.bricks));
    }

    // A place is free again once its subscriber is gone: 62 more than the two that are left.
    watching.undeclare().await.unwrap();
    let (mut beats, _beats) = hear(&client, &client.bus().keys().status(DEFAULT_MAP)).await;
    let more = v1::WatchRegionRequest { map_id: DEFAULT_MAP.into(), ..region() };
    let mut places = Vec::new();
    while places.len() < 62 {
        match planner.watch_region(more.clone()).await {
            Ok(place) => places.push(place),
            // The server has not heard of it yet.
            Err(status) => {
                assert_eq!(status.code(), tonic::Code::ResourceExhausted, "{status}");
                beats.recv().await.unwrap();
            }
        }
    }
    drop((places, news, ways));
    server.stop().await.0.unwrap();
    // Why, and then that it ends.
    let mut last = bricks.recv().await.unwrap();
    while last.kind() == SampleKind::Put {
        if *last.encoding() == encoding_of("QueryError") {
            let error: v1::QueryError = message(&last, "QueryError");
            assert!(error.message.contains("ended"), "{error:?}");
        }
        last = bricks.recv().await.unwrap();
    }
    drop(client);
}

#[tokio::test(flavor = "multi_thread")]
async fn watches_are_refused_by_name() {
    let router = Router::start();
    let (server, client) = start_on(&router, |_| {}).await;
    let fine = v1::WatchRegionRequest { voxel_m: 0.001, ..region() };
    let attic = v1::WatchRegionRequest { map_id: "attic".into(), ..region() };
    let mut elsewhere = way();
    elsewhere.check.as_mut().unwrap().map_id = "attic".into();
    for (told, field) in [
        (refusal(&client, "watch_region", &fine).await, "region"),
        (refusal(&client, "watch_region", &attic).await, "map_id"),
        (refusal(&client, "watch_trajectories", &elsewhere).await, "check.map_id"),
        (
            refusal(&client, "watch_trajectories", &v1::WatchTrajectoryRequest::default()).await,
            "check",
        ),
    ] {
        assert_eq!(told.field, field, "{told:?}");
    }
    drop(client);
    server.stop().await.0.unwrap();
}
