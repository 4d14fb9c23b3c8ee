//! Maps as files: made, sent, taken in, restored, by hand and by the clock.

use glam::Vec3;
use orenx::client::Client;
use orenx::error::Status;
use orenx::map::Fields;
use orenx::service::DEFAULT_MAP;
use orenx::wire::v1::FrameStatus;

use super::{good_frame, open_stream, start, verdict};

/// What a map says at some places, to the bit.
pub(crate) async fn answers(client: &Client, map_id: &str) -> (Vec<u8>, Vec<u32>) {
    let places: Vec<Vec3> = (0..2000u16)
        .map(|i| {
            let [x, y, z] = [i % 20, i / 20 % 10, i / 200].map(f32::from);
            Vec3::new(x * 0.3 - 3.0, y * 0.5 - 2.5, z * 0.25)
        })
        .collect();
    let reply = client.query_points(map_id, &places, Fields::ALL, 0).await.unwrap();
    (reply.answers.state, reply.answers.distance.iter().map(|d| d.to_bits()).collect())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_map_becomes_what_it_was_and_a_crash_does_not_undo_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("maps");
    let server = start(|settings| settings.storage.path = path.clone()).await;
    let client = &server.client;
    let (frames, mut acks) = open_stream(&server.channel).await;
    for seq in [0, 30] {
        frames.send(good_frame(seq)).await.unwrap();
        assert_eq!(verdict(&mut acks).await.status(), FrameStatus::Integrated);
    }
    let made = client.create_snapshot(DEFAULT_MAP, Some("early")).await.unwrap();
    assert_eq!((made.name.as_str(), made.epoch, made.frames), ("early", 2, 2));
    assert!(made.bytes > 1000 && made.created_ns > 0, "{made:?}");
    let before = answers(client, DEFAULT_MAP).await;
    frames.send(good_frame(60)).await.unwrap();
    assert_eq!(verdict(&mut acks).await.epoch, 3);
    assert_ne!(answers(client, DEFAULT_MAP).await, before, "the third frame shows");
    for (name, part) in [("early", "exists already"), ("Early", "name: "), ("auto-1", "timer")] {
        let error = client.create_snapshot(DEFAULT_MAP, Some(name)).await.expect_err(part);
        assert!(error.to_string().contains(part), "{error}");
    }

    let restored = client.restore_snapshot(DEFAULT_MAP, "early").await.unwrap();
    assert_eq!((restored.epoch, restored.frames_dropped), (4, 0), "a later epoch");
    assert_eq!(answers(client, DEFAULT_MAP).await, before);
    let stats = client.map_stats(DEFAULT_MAP).await.unwrap();
    assert_eq!((stats.stats.frames, stats.storage.problem.as_str()), (2, ""));
    // What a crash would leave: the file as it is now.
    let crashed = folder.path().join("crashed");
    std::fs::create_dir_all(crashed.join("default")).unwrap();
    std::fs::copy(path.join("default/map.orenx"), crashed.join("default/map.orenx")).unwrap();
    frames.send(good_frame(90)).await.unwrap();
    assert_eq!(verdict(&mut acks).await.epoch, 5, "it goes on");

    client.delete_snapshot(DEFAULT_MAP, "early").await.unwrap();
    for call in [
        client.delete_snapshot(DEFAULT_MAP, "early").await.err(),
        client.restore_snapshot(DEFAULT_MAP, "early").await.err(),
        client.list_snapshots("attic").await.err(),
    ] {
        assert_eq!(call.expect("gone").status(), Status::NotFound);
    }
    drop((frames, acks));
    server.stop().await.1.unwrap();
    let server = start(|settings| settings.storage.path = crashed.clone()).await;
    assert_eq!(answers(&server.client, DEFAULT_MAP).await, before);
    assert_eq!(server.client.map_stats(DEFAULT_MAP).await.unwrap().summary.epoch, 4);
    server.stop().await.1.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_snapshot_travels_to_another_server() {
    let folder = tempfile::tempdir().unwrap();
    let [one, two] = ["one", "two"].map(|name| folder.path().join(name));
    let from = start(|settings| settings.storage.path = one.clone()).await;
    let (frames, mut acks) = open_stream(&from.channel).await;
    frames.send(good_frame(0)).await.unwrap();
    verdict(&mut acks).await;
    let made = from.client.create_snapshot(DEFAULT_MAP, None).await.unwrap();
    assert!(made.name.starts_with("manual-"), "{}", made.name);
    let mut file = Vec::new();
    let bytes = from.client.download_snapshot(DEFAULT_MAP, &made.name, &mut file).await.unwrap();
    assert_eq!((bytes, file.len() as u64), (made.bytes, made.bytes));

    let to = start(|settings| {
        settings.storage.path = two.clone();
        settings.storage.max_snapshot_mib = (made.bytes >> 20) as u32 + 1;
    })
    .await;
    let mut damaged = file.clone();
    damaged[file.len() / 3] ^= 1;
    let large = vec![0; ((made.bytes >> 20) as usize + 2) << 20];
    for (bad, part) in [(damaged, "is no snapshot"), (large, "storage.max_snapshot_mib")] {
        let sent = to.client.upload_snapshot(DEFAULT_MAP, "home", std::io::Cursor::new(bad)).await;
        let error = sent.expect_err(part).to_string();
        assert!(error.contains(part), "{error}");
    }
    let sent = std::io::Cursor::new(file);
    let uploaded = to.client.upload_snapshot(DEFAULT_MAP, "home", sent).await.unwrap();
    assert_eq!((uploaded.bytes, uploaded.frames), (made.bytes, 1));
    let listed = to.client.list_snapshots(DEFAULT_MAP).await.unwrap();
    assert_eq!(listed, [uploaded], "and nothing of the bad ones");
    to.client.restore_snapshot(DEFAULT_MAP, "home").await.unwrap();
    let expected = answers(&from.client, DEFAULT_MAP).await;
    assert_eq!(answers(&to.client, DEFAULT_MAP).await, expected);
    drop((frames, acks));
    from.stop().await.1.unwrap();
    to.stop().await.1.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn the_clock_saves_a_map_that_changed() {
    let folder = tempfile::tempdir().unwrap();
    let server = start(|settings| {
        settings.storage.path = folder.path().into();
        (settings.storage.snapshot_interval_s, settings.storage.keep_snapshots) = (1, 2);
    })
    .await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    frames.send(good_frame(0)).await.unwrap();
    verdict(&mut acks).await;
    let deadline = std::time::Instant::now() + std::time::Duration::from_secs(60);
    let saved = loop {
        let storage = server.client.map_stats(DEFAULT_MAP).await.unwrap().storage;
        if storage.saved_epoch > 0 {
            break storage;
        }
        assert!(std::time::Instant::now() < deadline, "it is never saved");
        tokio::task::yield_now().await;
    };
    assert!(saved.saved_epoch == 1 && saved.saved_at.is_some(), "{saved:?}");
    let listed = server.client.list_snapshots(DEFAULT_MAP).await.unwrap();
    let [timed] = &listed[..] else { panic!("{listed:?}") };
    assert!(timed.name.starts_with("auto-") && timed.frames == 1, "{timed:?}");
    let file = std::fs::read(folder.path().join("default/map.orenx")).unwrap();
    let mut snapshot = Vec::new();
    server.client.download_snapshot(DEFAULT_MAP, &timed.name, &mut snapshot).await.unwrap();
    assert!(file == snapshot, "the map's own file and the snapshot are the same");
    drop((frames, acks));
    server.stop().await.1.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_map_that_cannot_be_loaded_comes_back_by_a_snapshot_or_by_a_reset() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let server = start(|settings| settings.storage.path = path.into()).await;
    server.client.create_map("yard", []).await.unwrap();
    let (frames, mut acks) = open_stream(&server.channel).await;
    for map_id in [DEFAULT_MAP, "yard"] {
        let frame = orenx::wire::v1::Frame { map_id: map_id.into(), ..good_frame(0) };
        frames.send(frame).await.unwrap();
        assert_eq!(verdict(&mut acks).await.status(), FrameStatus::Integrated);
    }
    server.client.create_snapshot("yard", Some("good")).await.unwrap();
    let before = answers(&server.client, "yard").await;
    drop((frames, acks));
    server.stop().await.1.unwrap();
    // One of a newer version, and one with a flipped bit.
    for (map_id, at) in [(DEFAULT_MAP, 8), ("yard", 5000)] {
        let file = path.join(map_id).join("map.orenx");
        let mut bytes = std::fs::read(&file).unwrap();
        bytes[at] ^= 2;
        std::fs::write(&file, bytes).unwrap();
    }

    let server = start(|settings| settings.storage.path = path.into()).await;
    let client = &server.client;
    let maps = client.list_maps().await.unwrap();
    assert!(maps[0].problem.contains("newer orenx"), "{}", maps[0].problem);
    assert!(maps[1].problem.contains("is damaged"), "{}", maps[1].problem);
    let listed = client.list_snapshots("yard").await.unwrap();
    assert_eq!(listed.len(), 1, "they are there all the same");
    let refused = client.create_snapshot("yard", None).await.expect_err("there is no map");
    assert_eq!(refused.status(), Status::FailedPrecondition);
    let restored = client.restore_snapshot("yard", "good").await.unwrap();
    assert!(restored.epoch > 1, "later than what the damaged file tells: {restored:?}");
    assert_eq!(answers(client, "yard").await, before);
    client.reset_map(DEFAULT_MAP).await.unwrap();
    assert_eq!(client.map_stats(DEFAULT_MAP).await.unwrap().stats.frames, 0);
    for map_id in [DEFAULT_MAP, "yard"] {
        let names = std::fs::read_dir(path.join(map_id)).unwrap();
        let aside = |name: &str| name.starts_with("map.orenx.damaged-");
        let aside = names.filter(|n| aside(n.as_ref().unwrap().file_name().to_str().unwrap()));
        assert_eq!(aside.count(), 1, "{map_id}: the file is kept");
    }
    assert!(client.list_maps().await.unwrap().iter().all(|map| map.problem.is_empty()));
    server.stop().await.1.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn what_cannot_be_saved_is_not_said_to_be_done() {
    let folder = tempfile::tempdir().unwrap();
    let server = start(|settings| settings.storage.path = folder.path().into()).await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    frames.send(good_frame(0)).await.unwrap();
    verdict(&mut acks).await;
    // A folder in the place of the file, which no rename replaces.
    let file = folder.path().join("default/map.orenx");
    std::fs::create_dir_all(file.join("in-the-way")).unwrap();
    let refused = server.client.reset_map(DEFAULT_MAP).await.expect_err("not saved");
    assert!(refused.to_string().contains("map.orenx"), "{refused}");
    let stats = server.client.map_stats(DEFAULT_MAP).await.unwrap();
    assert_eq!(stats.stats.frames, 1, "the map is as it was");
    assert!(stats.storage.problem.contains("could not be saved"), "{}", stats.storage.problem);
    let sample = r#"orenx_map_storage_problem{map="default"}"#;
    assert_eq!(crate::http::metric(&server.http, sample).await, 1.0);

    std::fs::remove_dir_all(&file).unwrap();
    server.client.reset_map(DEFAULT_MAP).await.unwrap();
    assert_eq!(server.client.map_stats(DEFAULT_MAP).await.unwrap().storage.problem, "");
    drop((frames, acks));
    server.stop().await.1.unwrap();

    let memory = start(|_| {}).await;
    let refused = memory.client.create_snapshot(DEFAULT_MAP, None).await.expect_err("no folder");
    assert!(refused.to_string().contains("storage.path"), "{refused}");
    memory.stop().await.1.unwrap();
}
