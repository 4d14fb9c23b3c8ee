//! What there is to know about maps, and the way back to an empty one.

use glam::Vec3;
use orenx::dataset::Dataset;
use orenx::dataset::synthetic::Synthetic;
use orenx::error::Status;
use orenx::map::{Fields, State};
use orenx::service::{DEFAULT_MAP, PointsQuestion, Unknown, UnknownPolicy};
use orenx::wire::v1;
use orenx::wire::v1::FrameStatus;
use tonic::Code;

use crate::support::command::done;

use super::{good_frame, open_stream, start, verdict};

#[tokio::test(flavor = "multi_thread")]
async fn a_map_tells_what_it_was_made_with() {
    let server = start(|settings| settings.map.r0_m = 0.2).await;
    let mut maps = v1::maps_client::MapsClient::new(server.channel.clone());
    let request = v1::GetMapRequest { map_id: DEFAULT_MAP.into() };
    let reply = maps.get_map(request).await.unwrap().into_inner();
    let (map, settings) = (reply.map.unwrap(), reply.settings.unwrap());
    assert_eq!((map.map_id.as_str(), map.epoch, reply.epoch), (DEFAULT_MAP, 0, 0));
    assert_eq!((settings.r0_m, settings.max_distance_m), (0.2, 2.0));
    let words = [settings.profile, settings.schedule, settings.prior];
    assert_eq!(words, ["lite", "fixed", "closed"]);
    for map_id in ["", "attic"] {
        let code = if map_id.is_empty() { Code::InvalidArgument } else { Code::NotFound };
        let status = maps.get_map(v1::GetMapRequest { map_id: map_id.into() }).await;
        assert_eq!(status.expect_err(map_id).code(), code);
        let status = maps.reset_map(v1::ResetMapRequest { map_id: map_id.into() }).await;
        assert_eq!(status.expect_err(map_id).code(), code);
    }
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_reset_map_is_empty_of_a_later_epoch_and_takes_frames_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("maps");
    let server = start(|settings| settings.storage.path = path.clone()).await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    for seq in [0, 30] {
        frames.send(good_frame(seq)).await.unwrap();
        assert_eq!(verdict(&mut acks).await.status(), FrameStatus::Integrated);
    }
    let before = server.client.map_stats(DEFAULT_MAP).await.unwrap();
    assert!(before.stats.surfels > 0 && before.summary.epoch == 2);

    let emptied = server.client.reset_map(DEFAULT_MAP).await.unwrap();
    assert_eq!((emptied.epoch, emptied.frames_dropped), (3, 0));
    let after = server.client.map_stats(DEFAULT_MAP).await.unwrap();
    assert_eq!((after.summary.epoch, after.summary.newest_stamp_ns), (3, 0));
    assert!(after.summary.bounds.is_empty());
    assert_eq!((after.stats.frames, after.stats.surfels, after.stats.voxels), (0, 0, 0));
    let places = [Vec3::new(0.0, 0.3, 1.0); 3];
    let reply = server.client.query_points(DEFAULT_MAP, &places, Fields::ALL, 3).await.unwrap();
    assert_eq!(reply.answers.state, [State::Unknown as u8; 3]);

    frames.send(good_frame(60)).await.unwrap();
    let ack = verdict(&mut acks).await;
    assert_eq!((ack.status(), ack.epoch), (FrameStatus::Integrated, 4));
    let again = server.client.reset_map(DEFAULT_MAP).await.unwrap();
    assert_eq!(again.epoch, 5);
    drop((frames, acks));
    let (served, saved) = server.stop().await;
    served.unwrap();
    saved.unwrap();

    let server = start(|settings| settings.storage.path = path.clone()).await;
    let stored = server.client.map_stats(DEFAULT_MAP).await.unwrap();
    assert_eq!((stored.summary.epoch, stored.stats.surfels), (5, 0), "the empty map was saved");
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_planner_demands_freshness_and_says_what_unknown_is() {
    let server = start(|_| {}).await;
    let minute = std::time::Duration::from_secs(60);
    let mut question = PointsQuestion::new(vec![Vec3::splat(900.0)]);
    question.max_age = Some(minute);
    let refused = server.client.ask(&question).await.expect_err("no frame yet");
    assert_eq!(refused.status(), Status::FailedPrecondition);
    assert!(refused.to_string().starts_with("max_age_ms: "), "{refused}");

    let (frames, mut acks) = open_stream(&server.channel).await;
    frames.send(good_frame(0)).await.unwrap();
    verdict(&mut acks).await;
    // Stamped long ago, and yet fresh: it came just now.
    let reply = server.client.ask(&question).await.unwrap();
    assert!(reply.answers.distance[0].is_nan());
    for (policy, distance_m, expected) in [
        (UnknownPolicy::Free, None, (2.0, 0.0)),
        (UnknownPolicy::Occupied, None, (-2.0, 1.0)),
        (UnknownPolicy::Occupied, Some(1000.0), (-1000.0, 1.0)),
    ] {
        question.unknown = Unknown { policy, distance_m };
        let answers = server.client.ask(&question).await.unwrap().answers;
        assert_eq!((answers.distance[0], answers.occupancy[0]), expected);
        assert_eq!((answers.gradient[0], answers.state[0]), (Vec3::ZERO, State::Unknown as u8));
    }
    server.client.reset_map(DEFAULT_MAP).await.unwrap();
    server.client.ask(&question).await.expect_err("the frames are gone");
    drop((frames, acks));
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn maps_come_and_go_and_keep_apart_what_they_saw() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("maps");
    let server = start(|settings| {
        settings.storage.path = path.clone();
        settings.server.max_maps = 2;
    })
    .await;
    let client = &server.client;
    let fine = [("r0_m".to_owned(), "0.2".to_owned())];
    client.create_map("yard", fine.clone()).await.unwrap();
    assert!(path.join("yard/map.orenx").is_file(), "it is on disk before it is served");
    for (map_id, settings, field) in [
        ("yard", vec![], "exists already"),
        ("Yard", vec![], "map_id: "),
        ("hall", vec![("r0_m".to_owned(), "wide".to_owned())], "settings.r0_m: "),
        ("hall", vec![], "server.max_maps"),
    ] {
        let error = client.create_map(map_id, settings).await.expect_err(field).to_string();
        assert!(error.contains(field), "{error}");
    }

    let (frames, mut acks) = open_stream(&server.channel).await;
    let frame = v1::Frame { map_id: "yard".into(), ..good_frame(3) };
    frames.send(frame).await.unwrap();
    let ack = verdict(&mut acks).await;
    assert_eq!((ack.status(), ack.epoch), (FrameStatus::Integrated, 1), "the epoch of its map");
    let yard = client.map_stats("yard").await.unwrap();
    assert_eq!((yard.stats.frames, yard.counts.integrated), (1, 1));
    let robot = &yard.robots[0];
    assert_eq!((robot.robot_id.as_str(), robot.counts.integrated), ("recording", 1));
    let room = Synthetic::room(100).with_width(64);
    let sent = room.load(3, false).unwrap();
    assert_eq!(robot.newest.world_from_camera, sent.world_from_camera);
    assert_eq!(robot.newest.intrinsics, sent.intrinsics);
    let other = client.map_stats(DEFAULT_MAP).await.unwrap();
    assert_eq!((other.stats.frames, other.counts.received, other.robots.len()), (0, 0, 0));

    let url = server.url.clone();
    let room = "synthetic:room:frames=2,width=64";
    let sent = move || done(&["stream", room, &url, "--map", "yard"]);
    tokio::task::spawn_blocking(sent).await.unwrap();
    assert_eq!(client.map_stats("yard").await.unwrap().stats.frames, 3, "from the command line");
    assert_eq!(client.map_stats(DEFAULT_MAP).await.unwrap().stats.frames, 0);

    let error = client.delete_map(DEFAULT_MAP).await.expect_err("it stays").to_string();
    assert!(error.contains("can be reset"), "{error}");
    drop((frames, acks));
    server.stop().await.1.unwrap();
    let server = start(|settings| settings.storage.path = path.clone()).await;
    assert_eq!(server.client.map_stats("yard").await.unwrap().stats.frames, 3, "it was saved");
    server.client.delete_map("yard").await.unwrap();
    assert!(!path.join("yard").exists());
    let gone = server.client.map_stats("yard").await.expect_err("gone");
    assert_eq!(gone.status(), Status::NotFound);
    server.client.delete_map("yard").await.expect_err("only once");
    server.client.create_map("yard", fine).await.unwrap();
    assert_eq!(server.client.map_stats("yard").await.unwrap().stats.frames, 0);
    server.stop().await.1.unwrap();
}
