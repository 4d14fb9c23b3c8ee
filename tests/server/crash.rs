//! The program itself, killed again and again.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use orenx::client::Client;
use orenx::service::DEFAULT_MAP;
use orenx::wire::v1::FrameStatus;
use tokio::sync::oneshot;
use tonic::transport::Channel;

use super::snapshots::answers;
use super::{good_frame, open_stream, start, verdict};

const KILLS: u64 = 20;
/// Of one lap: their stamps grow.
const FRAMES: u64 = 100;

/// `orenx serve` as a process; killed when it is dropped.
struct Process {
    child: Child,
    client: Client,
    channel: Channel,
}

impl Process {
    async fn start(path: &Path) -> Self {
        // A limit of the size of files, as one of the tests sets, is an error and not a signal.
        let mut child = Command::new("sh")
            .args(["-c", r#"trap "" XFSZ; exec "$0" "$@""#, env!("CARGO_BIN_EXE_orenx"), "serve"])
            .args(["--set", "server.grpc=127.0.0.1:0", "--set", "server.http="])
            .args(["--set", "storage.journal=on", "--set", "map.backend=cpu"])
            .args(["--set", "map.schedule=fixed", "--set", "map.steps=0"])
            .args(["--set", &format!("storage.path={}", path.display())])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let stdout = BufReader::new(child.stdout.take().unwrap());
        let (found, url) = oneshot::channel();
        // Read to its end, so that the server can go on printing.
        std::thread::spawn(move || {
            let mut found = Some(found);
            for line in stdout.lines().map_while(Result::ok) {
                if let Some((_, url)) = line.split_once("gRPC on ")
                    && let Some(found) = found.take()
                {
                    let _ = found.send(url.to_owned());
                }
            }
        });
        let url = url.await.expect("it serves").replace("grpc://", "http://");
        let client = Client::connect(&url).await.unwrap();
        let channel = Channel::from_shared(url).unwrap().connect().await.unwrap();
        Self { child, client, channel }
    }

    /// `kill -9`.
    fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Numbers that are the same each time.
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, bound: u64) -> u64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % bound
    }
}

/// Sends frames from `from` on until so many acks have come, or all frames have their verdicts; how many
/// frames are safe then.
async fn stream(process: &Process, from: u64, acks_until: u64) -> u64 {
    let (frames, mut acks) = open_stream(&process.channel).await;
    let sending = tokio::spawn(async move {
        for seq in from..FRAMES {
            // A server that is killed takes no more.
            if frames.send(good_frame(seq)).await.is_err() {
                return;
            }
        }
    });
    let (mut safe, mut settled) = (from, from);
    for _ in 0..acks_until {
        let Ok(Some(ack)) = acks.message().await else { break };
        match ack.status() {
            FrameStatus::Durable => safe = ack.seq + 1,
            FrameStatus::Integrated => settled = ack.seq + 1,
            FrameStatus::Accepted => {}
            other => panic!("{other:?}: {}", ack.message),
        }
        if settled == FRAMES {
            break;
        }
    }
    sending.abort();
    safe
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_that_is_killed_twenty_times_loses_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let mut numbers = Numbers(20);
    let (mut safe, mut recovered) = (0, 0);
    for kill in 0..KILLS {
        let process = Process::start(folder.path()).await;
        let stats = process.client.map_stats(DEFAULT_MAP).await.unwrap();
        let there = stats.stats.frames;
        assert!(there >= safe, "kill {kill}: {there} frames of {safe} that were safe");
        assert_eq!(stats.storage.problem, "");
        recovered += u64::from(stats.storage.recovery.contains("mapped again"));
        // The sender goes on behind what the map has: frames that it never heard of may be there.
        safe = stream(&process, there, 1 + numbers.below(18)).await.max(there);
        process.kill();
    }
    assert!(recovered > KILLS / 2, "{recovered} times the journal was needed");

    let process = Process::start(folder.path()).await;
    let there = process.client.map_stats(DEFAULT_MAP).await.unwrap().stats.frames;
    assert!((safe..=FRAMES).contains(&there), "{there} of {safe}");
    assert_eq!(stream(&process, there, u64::MAX).await, FRAMES);
    let survivor = answers(&process.client, DEFAULT_MAP).await;
    assert_eq!(process.client.map_stats(DEFAULT_MAP).await.unwrap().stats.frames, FRAMES);
    process.kill();

    let never_killed = start(|_| {}).await;
    let (frames, mut acks) = open_stream(&never_killed.channel).await;
    for seq in 0..FRAMES {
        frames.send(good_frame(seq)).await.unwrap();
        assert_eq!(verdict(&mut acks).await.status(), FrameStatus::Integrated);
    }
    assert!(answers(&never_killed.client, DEFAULT_MAP).await == survivor, "to the bit");
    drop((frames, acks));
    never_killed.stop().await.1.unwrap();
}

#[cfg(target_os = "linux")]
#[tokio::test(flavor = "multi_thread")]
async fn a_disk_that_is_full_costs_durability_and_no_frame() {
    use rustix::process::{Pid, Resource, Rlimit, prlimit};

    let folder = tempfile::tempdir().unwrap();
    let process = Process::start(folder.path()).await;
    let pid = Pid::from_child(&process.child);
    let (frames, mut acks) = open_stream(&process.channel).await;
    let mut next = async |seq: u64| {
        frames.send(good_frame(seq)).await.unwrap();
        let mut is_durable = false;
        loop {
            let ack = acks.message().await.unwrap().expect("an ack");
            match ack.status() {
                FrameStatus::Accepted => {}
                FrameStatus::Durable => is_durable = true,
                FrameStatus::Integrated => return (is_durable, ack.message),
                other => panic!("{other:?}: {}", ack.message),
            }
        }
    };
    assert_eq!(next(0).await, (true, String::new()));
    // No file may grow beyond this, which is what a full disk looks like.
    let full = Rlimit { current: Some(1000), maximum: None };
    let usual = prlimit(Some(pid), Resource::Fsize, full).unwrap();
    for seq in 1..4 {
        let (is_durable, message) = next(seq).await;
        assert!(!is_durable && message.starts_with("not durable: "), "{seq}: {message}");
    }
    let stats = process.client.map_stats(DEFAULT_MAP).await.unwrap();
    assert_eq!(stats.stats.frames, 4, "it goes on mapping");
    assert!(stats.storage.problem.contains("not journaled"), "{}", stats.storage.problem);

    prlimit(Some(pid), Resource::Fsize, usual).unwrap();
    assert_eq!(next(4).await, (true, String::new()), "there is room again");
    // What went without the journal is safe as soon as the map is saved.
    let saved = async {
        let mut seq = 5;
        while process.client.map_stats(DEFAULT_MAP).await.unwrap().storage.saved_epoch < 4 {
            next(seq).await;
            seq += 1;
        }
        seq
    };
    let sent = tokio::time::timeout(Duration::from_secs(60), saved).await.expect("it is saved");
    process.kill();
    let again = Process::start(folder.path()).await;
    assert_eq!(again.client.map_stats(DEFAULT_MAP).await.unwrap().stats.frames, sent);
    again.kill();
}
