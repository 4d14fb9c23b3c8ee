//! A map changed by hand, over gRPC: in order with frames, published when it is answered, and saved.

use glam::{DVec3, Vec3};
use orenx::error::Status;
use orenx::geometry::{Aabb, Pose, Region, Solid};
use orenx::map::{Clear, Fields, STAMP_ROBOT, Stamp, State};
use orenx::service::DEFAULT_MAP;
use orenx::surface::Stamping;
use orenx::wire::v1;
use orenx::wire::v1::FrameStatus;
use tonic::Code;

use super::{good_frame, open_stream, start, verdict};

fn cube(center: DVec3, stamping: Stamping) -> Stamp {
    let world_from_box = Pose { translation: center, ..Pose::IDENTITY };
    Stamp {
        solid: Solid::Box { world_from_box, size_m: Vec3::splat(0.4) },
        stamping,
        color: None,
        robot_id: STAMP_ROBOT.into(),
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn edits_are_seen_when_they_are_answered_and_are_saved() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("maps");
    let server = start(|settings| settings.storage.path = path.clone()).await;
    let client = &server.client;
    let (frames, mut acks) = open_stream(&server.channel).await;
    frames.send(good_frame(0)).await.unwrap();
    assert_eq!(verdict(&mut acks).await.status(), FrameStatus::Integrated);
    let seen = client.map_stats(DEFAULT_MAP).await.unwrap();

    // Far from what the frame saw.
    let far = DVec3::new(20.0, 20.0, 1.0);
    let there = [far.as_vec3(), far.as_vec3() + Vec3::new(0.27, 0.0, 0.0)];
    let states = async |epoch| {
        let reply = client.query_points(DEFAULT_MAP, &there, Fields::ALL, epoch).await.unwrap();
        (reply.answers.state, reply.answers.distance)
    };
    let unknown = vec![State::Unknown as u8; 2];
    assert_eq!(states(0).await.0, unknown);
    let edited = client.stamp_geometry(DEFAULT_MAP, &cube(far, Stamping::Add)).await.unwrap();
    assert_eq!((edited.epoch, edited.surfels_removed), (seen.summary.epoch + 1, 0));
    let (state, distance) = states(edited.epoch).await;
    assert_eq!(state, [State::Occupied as u8, State::Free as u8]);
    assert!((distance[0] + 0.2).abs() < 0.03 && (distance[1] - 0.07).abs() < 0.02, "{distance:?}");
    drop((frames, acks));
    server.stop().await.1.unwrap();

    let server = start(|settings| settings.storage.path = path.clone()).await;
    let client = &server.client;
    let stored = client.map_stats(DEFAULT_MAP).await.unwrap();
    assert_eq!(stored.stats.surfels, seen.stats.surfels + edited.surfels_added);
    let clear = Clear { robot_id: Some(STAMP_ROBOT.into()), ..Clear::default() };
    let gone = client.clear_region(DEFAULT_MAP, &clear).await.unwrap();
    assert_eq!(gone.surfels_removed, edited.surfels_added);
    let reply = client.query_points(DEFAULT_MAP, &there, Fields::ALL, gone.epoch).await.unwrap();
    assert_eq!(reply.answers.state, unknown);
    // All that the frame saw.
    let everything = Aabb { min: Vec3::splat(-50.0), max: Vec3::splat(50.0) };
    let clear = Clear { region: Some(Region::Box(everything)), ..Clear::default() };
    let gone = client.clear_region(DEFAULT_MAP, &clear).await.unwrap();
    assert_eq!(gone.surfels_removed, seen.stats.surfels);
    server.stop().await.1.unwrap();
}

/// Frames that wait when an edit is asked for are in the map before it.
#[tokio::test(flavor = "multi_thread")]
async fn an_edit_comes_after_the_frames_that_wait() {
    let server = start(|_| {}).await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    for seq in 0..3 {
        frames.send(good_frame(seq)).await.unwrap();
    }
    // They wait, or are in, once they are accepted.
    let mut accepted = 0;
    while accepted < 3 {
        let ack = acks.message().await.unwrap().unwrap();
        accepted += usize::from(ack.status() == FrameStatus::Accepted);
    }
    let clear = Clear { robot_id: Some("recording".into()), ..Clear::default() };
    let edited = server.client.clear_region(DEFAULT_MAP, &clear).await.unwrap();
    let after = server.client.map_stats(DEFAULT_MAP).await.unwrap();
    assert_eq!((after.stats.frames, after.stats.surfels), (3, 0));
    assert_eq!(after.summary.epoch, edited.epoch);
    assert!(edited.surfels_removed > 0);
    drop((frames, acks));
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn edits_are_refused_by_name() {
    let server = start(|_| {}).await;
    let mut maps = v1::maps_client::MapsClient::new(server.channel.clone());
    let request =
        |map_id: &str| v1::ClearRegionRequest { map_id: map_id.into(), ..Default::default() };
    for (map_id, code, field) in [
        ("", Code::InvalidArgument, "map_id"),
        ("attic", Code::NotFound, "map_id"),
        (DEFAULT_MAP, Code::InvalidArgument, "clear"),
    ] {
        let status = maps.clear_region(request(map_id)).await.expect_err(field);
        assert!(status.code() == code && status.message().starts_with(field), "{status:?}");
    }
    let request = v1::StampGeometryRequest { map_id: DEFAULT_MAP.into(), ..Default::default() };
    let status = maps.stamp_geometry(request).await.expect_err("nothing");
    assert!(status.message().starts_with("geometry: "), "{status:?}");
    let clear = Clear { robot_id: Some("nobody".into()), ..Clear::default() };
    let error = server.client.clear_region(DEFAULT_MAP, &clear).await.expect_err("nobody");
    assert_eq!(error.status(), Status::NotFound);
    assert_eq!(server.client.map_stats(DEFAULT_MAP).await.unwrap().summary.epoch, 0);
    server.stop().await.0.unwrap();
}
