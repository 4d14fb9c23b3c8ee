//! A map that follows the server's in another thread, over a connection that is cut.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Duration;

use glam::Vec3;
use orenx::client::Mirror;
use orenx::error::Status;
use orenx::map::{Copied, Fields};
use orenx::service::{DEFAULT_MAP, PointsQuestion};
use orenx::wire::{Subscription, v1};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tonic::transport::Channel;

use super::{Running, good_frame, open_stream, start, verdict};

/// Longer than anything here takes; only a failure waits for so long.
const PATIENCE: Duration = Duration::from_secs(60);

const LOW: Vec3 = Vec3::new(-2.6, -2.1, -0.1);
const SIZE: Vec3 = Vec3::new(5.2, 4.2, 2.7);

/// Points all over the room.
fn points() -> Vec<Vec3> {
    let part = |i: usize, step: usize| (i * step % 101) as f32 / 101.0;
    let at = |i| LOW + SIZE * Vec3::new(part(i, 17), part(i, 41), part(i, 73));
    (0..3000).map(at).collect()
}

/// The server and the mirror say the same, bit for bit, at the same epoch.
async fn assert_same(server: &Running, mirror: &Arc<Mirror>, epoch: u64) {
    let reply = server.client.ask(&PointsQuestion::new(points())).await.unwrap();
    assert_eq!(reply.epoch, epoch, "nothing has come since");
    let mirror = mirror.clone();
    let view = tokio::task::spawn_blocking(move || mirror.view_since(epoch, PATIENCE)).await;
    let view = view.unwrap().expect("the epoch comes");
    assert_eq!((view.epoch(), view.newest_stamp_ns()), (epoch, reply.newest_stamp_ns));
    let own = view.query(&points(), Fields::ALL);
    let bits = |numbers: &[f32]| numbers.iter().map(|x| x.to_bits()).collect::<Vec<u32>>();
    let columns = |a: &orenx::map::PointAnswers| {
        let (gradient, color) = (bytemuck::cast_slice(&a.gradient), bytemuck::cast_slice(&a.color));
        [&a.distance, &a.occupancy, gradient, color].map(bits)
    };
    assert!(own.state == reply.answers.state, "states at {epoch}");
    assert!(columns(&own) == columns(&reply.answers), "numbers at {epoch}");
    assert!(own.distance.iter().filter(|d| d.is_finite()).count() > 100, "something is known");
}

async fn follow(url: String) -> Arc<Mirror> {
    let opened = tokio::task::spawn_blocking(move || Mirror::open(&url, DEFAULT_MAP));
    Arc::new(opened.await.unwrap().unwrap())
}

/// Dropping it joins its thread.
async fn drop_mirror(mirror: Arc<Mirror>) {
    tokio::task::spawn_blocking(move || drop(mirror)).await.unwrap();
}

/// Stands between a mirror and its server, and cuts each connection once so many bytes came back.
async fn cutting_proxy(server: String, allowances: &'static [u64]) -> (String, Arc<AtomicU64>) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    let cuts = Arc::<AtomicU64>::default();
    let counted = cuts.clone();
    tokio::spawn(async move {
        let mut connections = 0;
        while let Ok((mut near, _)) = listener.accept().await {
            let mut far = TcpStream::connect(&server).await.unwrap();
            let mut left = allowances.get(connections).copied().unwrap_or(u64::MAX);
            connections += 1;
            let counted = counted.clone();
            tokio::spawn(async move {
                let (mut from_near, mut to_near) = near.split();
                let (mut from_far, mut to_far) = far.split();
                let back = async {
                    let mut buffer = vec![0; 1 << 14];
                    loop {
                        let read = from_far.read(&mut buffer).await.unwrap_or(0) as u64;
                        if read == 0 {
                            return;
                        }
                        if read >= left {
                            counted.fetch_add(1, Relaxed);
                            return;
                        }
                        left -= read;
                        if to_near.write_all(&buffer[..read as usize]).await.is_err() {
                            return;
                        }
                    }
                };
                tokio::select! {
                    () = back => {}
                    _ = tokio::io::copy(&mut from_near, &mut to_far) => {}
                }
            });
        }
    });
    (url, cuts)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_mirror_is_the_server_bit_for_bit_however_often_it_is_cut() {
    let server = start(|_| {}).await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    frames.send(good_frame(1)).await.unwrap();
    verdict(&mut acks).await;
    let steady = follow(server.url.clone()).await;
    let address = server.url.trim_start_matches("http://").to_owned();
    // The first one has to come through for the mirror to open.
    let (url, cuts) =
        cutting_proxy(address, &[3_000_000, 200, 70_000, 1_000_000, 90, 2_500_000, 1_200_000])
            .await;
    let cut = follow(url).await;
    for seq in 2..12 {
        frames.send(good_frame(seq * 7)).await.unwrap();
        let ack = verdict(&mut acks).await;
        assert_same(&server, &steady, ack.epoch).await;
        assert_same(&server, &cut, ack.epoch).await;
    }
    assert_eq!(steady.state().starts, 1);
    assert!(steady.state().is_connected);
    let cuts = cuts.load(Relaxed);
    assert!(cuts >= 2, "{cuts} cuts");
    assert!((2..=1 + cuts).contains(&cut.state().starts), "{:?} after {cuts}", cut.state());

    // A map that is emptied begins anew, under the next epoch.
    let emptied = server.service.reset_map(DEFAULT_MAP).await.unwrap();
    let mirror = steady.clone();
    let empty = move || mirror.view_since(emptied.epoch, PATIENCE);
    let empty = tokio::task::spawn_blocking(empty).await.unwrap().expect("it comes");
    assert!(empty.bounds().is_empty());
    drop_mirror(steady).await;
    drop_mirror(cut).await;
    drop((frames, acks));
    let (served, ended) = server.stop().await;
    served.unwrap();
    ended.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn mirrors_have_bounds_and_say_what_is_wrong() {
    let server = start(|_| {}).await;
    // A connection of their own: what its streams do not read, others on it cannot read either.
    let theirs = Channel::from_shared(server.url.clone()).unwrap().connect().await.unwrap();
    let subscribe = |change: fn(&mut v1::SubscribeRequest)| {
        let mut asked = v1::SubscribeRequest { map_id: DEFAULT_MAP.into(), ..Default::default() };
        change(&mut asked);
        let mut client = v1::mirror_client::MirrorClient::new(theirs.clone());
        async move { client.subscribe(asked).await }
    };
    let refused = subscribe(|asked| asked.map_id = "cellar".into()).await.unwrap_err();
    assert_eq!(refused.code(), tonic::Code::NotFound);
    let refused = subscribe(|asked| asked.min_interval_ms = 60_001).await.unwrap_err();
    assert!(refused.message().contains("min_interval_ms: 60001"), "{refused}");

    // Readers that do not read hold no more than their places, and the mapper goes on.
    let url = server.url.clone();
    let copied = Copied { radiance: false, language: false };
    let lean = Subscription { copied, ..Subscription::whole(DEFAULT_MAP) };
    let lean = tokio::task::spawn_blocking(move || Mirror::follow(&url, lean)).await;
    let lean = Arc::new(lean.unwrap().unwrap());
    let mut idle = Vec::new();
    for _ in 1..16 {
        idle.push(subscribe(|_| {}).await.unwrap());
    }
    let refused = subscribe(|_| {}).await.unwrap_err();
    assert_eq!(refused.code(), tonic::Code::ResourceExhausted);
    assert!(refused.message().contains("16"), "{refused}");
    let (frames, mut acks) = open_stream(&server.channel).await;
    let mut epoch = 0;
    for seq in 1..4 {
        frames.send(good_frame(seq)).await.unwrap();
        let ack = verdict(&mut acks).await;
        assert_eq!(ack.status(), v1::FrameStatus::Integrated);
        epoch = ack.epoch;
    }
    let mirror = lean.clone();
    let view = tokio::task::spawn_blocking(move || mirror.view_since(epoch, PATIENCE)).await;
    let answers = view.unwrap().expect("it comes").query(&points(), Fields::ALL);
    assert!(answers.color.is_empty() && answers.distance.iter().any(|d| d.is_finite()));
    drop_mirror(lean).await;

    let url = server.url.clone();
    let wrong = tokio::task::spawn_blocking(move || Mirror::open(&url, "cellar").err()).await;
    assert_eq!(wrong.unwrap().unwrap().status(), Status::NotFound);
}
