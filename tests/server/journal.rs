//! What a crash leaves, and what is made of it. A copy of the folder of a running server is what would
//! be left if it were killed at that moment.

use std::path::{Path, PathBuf};

use orenx::config::{JournalMode, Settings};
use orenx::dataset::Dataset;
use orenx::dataset::synthetic::Synthetic;
use orenx::engine::QueuePolicy;
use orenx::map::Clear;
use orenx::service::DEFAULT_MAP;
use orenx::wire::frame_to_wire;
use orenx::wire::v1::{self, FrameStatus};
use tonic::Streaming;

use super::snapshots::answers;
use super::{Running, good_frame, open_stream, start};

async fn journaled(path: &Path) -> Running {
    start(|settings| in_journal(settings, path)).await
}

fn in_journal(settings: &mut Settings, path: &Path) {
    settings.storage.path = path.into();
    settings.storage.journal = JournalMode::On;
    settings.storage.journal_mib = 16;
}

/// What a frame's acks said, up to its verdict.
async fn told(acks: &mut Streaming<v1::FrameAck>) -> (Vec<FrameStatus>, String) {
    let mut told = Vec::new();
    loop {
        let ack = acks.message().await.unwrap().expect("an ack");
        told.push(ack.status());
        if !matches!(ack.status(), FrameStatus::Accepted | FrameStatus::Durable) {
            return (told, ack.message);
        }
    }
}

const SAFE: [FrameStatus; 3] =
    [FrameStatus::Accepted, FrameStatus::Durable, FrameStatus::Integrated];

/// Sends frames one by one, each of which is to be safe.
async fn send_safely(server: &Running, seqs: impl IntoIterator<Item = u64>) {
    let (frames, mut acks) = open_stream(&server.channel).await;
    for seq in seqs {
        frames.send(good_frame(seq)).await.unwrap();
        assert_eq!(told(&mut acks).await, (SAFE.to_vec(), String::new()));
    }
}

/// A copy of a folder.
fn copied(from: &Path, to: PathBuf) -> PathBuf {
    std::fs::create_dir_all(&to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        if entry.path().is_dir() {
            copied(&entry.path(), to.join(entry.file_name()));
        } else {
            std::fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
        }
    }
    to
}

fn segments(path: &Path) -> Vec<PathBuf> {
    let folder = path.join("default/journal");
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    files.retain(|file| file.extension().is_some_and(|extension| extension == "mcap"));
    files.sort();
    files
}

#[tokio::test(flavor = "multi_thread")]
async fn what_was_durable_is_there_after_a_crash_and_after_another() {
    let folder = tempfile::tempdir().unwrap();
    let server = journaled(&folder.path().join("one")).await;
    send_safely(&server, [0, 30, 60]).await;
    let storage = server.client.map_stats(DEFAULT_MAP).await.unwrap().storage;
    assert!(storage.journal && storage.journal_frames == 3 && storage.journal_bytes > 1000);
    assert_eq!((storage.problem.as_str(), storage.recovery.as_str()), ("", ""));
    let expected = answers(&server.client, DEFAULT_MAP).await;
    let crashed = copied(&folder.path().join("one"), folder.path().join("two"));
    // The power went while a fourth was written.
    let last = segments(&crashed).pop().unwrap();
    let whole = std::fs::read(&last).unwrap();
    let torn = [&whole[..], &[6, 0, 1, 0, 0, 0, 0, 0, 0], b"half of a fra"].concat();
    std::fs::write(&last, torn).unwrap();
    let twice = copied(&crashed, folder.path().join("three"));

    let again = journaled(&crashed).await;
    assert_eq!(answers(&again.client, DEFAULT_MAP).await, expected);
    let stats = again.client.map_stats(DEFAULT_MAP).await.unwrap();
    assert!(stats.stats.frames == 3 && stats.summary.epoch >= 3, "{:?}", stats.summary);
    let recovery = &stats.storage.recovery;
    assert!(recovery.contains("3 frames") && recovery.contains("22 bytes"), "{recovery}");
    send_safely(&again, [90]).await;
    let expected = answers(&again.client, DEFAULT_MAP).await;
    let crashed = copied(&crashed, folder.path().join("four"));
    again.stop().await.1.unwrap();
    assert!(segments(&folder.path().join("two")).is_empty(), "all of it is in the map's file");

    let again = journaled(&crashed).await;
    assert_eq!(answers(&again.client, DEFAULT_MAP).await, expected);
    assert_eq!(again.client.map_stats(DEFAULT_MAP).await.unwrap().stats.frames, 4);
    again.stop().await.1.unwrap();

    // Without a journal from now on: what was safe is mapped all the same, and the journal goes.
    let plain = start(|settings| settings.storage.path = twice.clone()).await;
    let stats = plain.client.map_stats(DEFAULT_MAP).await.unwrap();
    assert!(stats.stats.frames == 3 && !stats.storage.journal);
    plain.stop().await.1.unwrap();
    assert!(segments(&twice).is_empty());
    server.stop().await.1.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_reset_and_a_restored_snapshot_are_not_undone() {
    let folder = tempfile::tempdir().unwrap();
    let one = folder.path().join("one");
    let server = journaled(&one).await;
    send_safely(&server, [0, 30]).await;
    server.client.create_snapshot(DEFAULT_MAP, Some("two-frames")).await.unwrap();
    let two_frames = answers(&server.client, DEFAULT_MAP).await;
    send_safely(&server, [60]).await;
    server.client.reset_map(DEFAULT_MAP).await.unwrap();
    let after_reset = copied(&one, folder.path().join("reset"));
    send_safely(&server, [61]).await;
    let after_frame = copied(&one, folder.path().join("frame"));
    server.client.restore_snapshot(DEFAULT_MAP, "two-frames").await.unwrap();
    let after_restore = copied(&one, folder.path().join("restored"));
    server.stop().await.1.unwrap();

    for (path, frames) in [(after_reset, 0), (after_frame, 1), (after_restore.clone(), 2)] {
        let again = journaled(&path).await;
        let stats = again.client.map_stats(DEFAULT_MAP).await.unwrap();
        assert_eq!(stats.stats.frames, frames, "{}", path.display());
        if path == after_restore {
            assert_eq!(answers(&again.client, DEFAULT_MAP).await, two_frames);
        }
        again.stop().await.1.unwrap();
    }
}

/// A journal knows of frames alone: mapping them again must not bring back what was cleared.
#[tokio::test(flavor = "multi_thread")]
async fn a_map_that_was_cleared_stays_so() {
    let folder = tempfile::tempdir().unwrap();
    let one = folder.path().join("one");
    let server = journaled(&one).await;
    send_safely(&server, [0, 30]).await;
    let everything = Clear { robot_id: Some("recording".into()), ..Clear::default() };
    let edited = server.client.clear_region(DEFAULT_MAP, &everything).await.unwrap();
    assert!(edited.surfels_removed > 0, "{edited:?}");
    let crashed = copied(&one, folder.path().join("cleared"));
    server.stop().await.1.unwrap();

    let again = journaled(&crashed).await;
    let stats = again.client.map_stats(DEFAULT_MAP).await.unwrap().stats;
    assert_eq!((stats.frames, stats.surfels), (2, 0));
    again.stop().await.1.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_journal_that_cannot_be_written_is_told_of_and_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let one = folder.path().join("one");
    let journal = one.join("default/journal");
    std::fs::create_dir_all(journal.parent().unwrap()).unwrap();
    std::fs::write(&journal, b"in the way").unwrap();
    let server = journaled(&one).await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    frames.send(good_frame(0)).await.unwrap();
    let (statuses, message) = told(&mut acks).await;
    assert_eq!(statuses, [FrameStatus::Accepted, FrameStatus::Integrated], "it is mapped");
    assert!(message.starts_with("not durable: ") && message.contains("journal"), "{message}");
    let storage = server.client.map_stats(DEFAULT_MAP).await.unwrap().storage;
    assert!(storage.problem.contains("not journaled"), "{}", storage.problem);
    let sample = r#"orenx_map_storage_problem{map="default"}"#;
    assert_eq!(crate::http::metric(&server.http, sample).await, 1.0);

    std::fs::remove_file(&journal).unwrap();
    frames.send(good_frame(30)).await.unwrap();
    assert_eq!(told(&mut acks).await, (SAFE.to_vec(), String::new()));
    assert_eq!(server.client.map_stats(DEFAULT_MAP).await.unwrap().storage.problem, "");
    // The frame that went without is safe once the map is saved, which the journal asks for.
    frames.send(good_frame(60)).await.unwrap();
    told(&mut acks).await;
    until_saved(&server, 2).await;
    let crashed = copied(&one, folder.path().join("crashed"));
    let again = journaled(&crashed).await;
    assert_eq!(again.client.map_stats(DEFAULT_MAP).await.unwrap().stats.frames, 3);
    again.stop().await.1.unwrap();
    drop((frames, acks));
    server.stop().await.1.unwrap();
}

/// Waits until the map's file holds this epoch.
async fn until_saved(server: &Running, epoch: u64) {
    let saved = async {
        while server.client.map_stats(DEFAULT_MAP).await.unwrap().storage.saved_epoch < epoch {
            tokio::task::yield_now().await;
        }
    };
    tokio::time::timeout(std::time::Duration::from_secs(60), saved).await.expect("it is saved");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_journal_is_bounded_by_saving_and_then_by_saying_so() {
    let folder = tempfile::tempdir().unwrap();
    let server = journaled(folder.path()).await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    let room = Synthetic::room(100).with_width(480);
    let mut large = async |seq: u64| {
        let mut frame = room.load(seq as usize, true).unwrap();
        frame.seq = seq;
        frames.send(frame_to_wire(DEFAULT_MAP, &frame, QueuePolicy::Block)).await.unwrap();
        told(&mut acks).await
    };
    // More than the half of 16 MiB: the map is saved, and what the journal held goes.
    for seq in 0..9 {
        assert_eq!(large(seq).await, (SAFE.to_vec(), String::new()), "{seq}");
    }
    until_saved(&server, 5).await;
    // A folder in the place of the file, which no rename replaces: the map cannot be saved any more.
    let file = folder.path().join("default/map.orenx");
    std::fs::remove_file(&file).unwrap();
    std::fs::create_dir_all(file.join("in-the-way")).unwrap();
    let mut lapsed = None;
    for seq in 9..40 {
        let (statuses, message) = large(seq).await;
        if statuses != SAFE {
            lapsed = Some(message);
            break;
        }
    }
    let message = lapsed.expect("there is a bound");
    assert!(message.contains("storage.journal_mib"), "{message}");
    let bytes: u64 = segments(folder.path()).iter().map(|f| f.metadata().unwrap().len()).sum();
    assert!((8 << 20..=16 << 20).contains(&bytes), "{bytes}");
    let both = async {
        loop {
            let problem = server.client.map_stats(DEFAULT_MAP).await.unwrap().storage.problem;
            if problem.contains("could not be saved") && problem.contains("not journaled") {
                break;
            }
            tokio::task::yield_now().await;
        }
    };
    tokio::time::timeout(std::time::Duration::from_secs(60), both).await.expect("both are told");
    server.stop().await.1.expect_err("it cannot be saved at the end either");
}
