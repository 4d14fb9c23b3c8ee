//! A robot that dies in the middle of a frame.

use orenx::client::ZenohClient;
use orenx::service::DEFAULT_MAP;
use orenx::wire::v1::FrameStatus;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};

use super::router::Router;
use super::{Robot, start_on};

/// How much of the robot's last frame arrives, bytes.
const PART: usize = 100_000;

/// Passes on what two ends say to each other, until `cut`: from then on `PART` more bytes of the robot,
/// and then nothing, as if its power were gone.
async fn line(
    listener: TcpListener,
    router: String,
    mut cut: tokio::sync::watch::Receiver<bool>,
) -> usize {
    let (robot, _) = listener.accept().await.unwrap();
    let router = TcpStream::connect(router).await.unwrap();
    let (mut from_robot, mut to_robot) = robot.into_split();
    let (mut from_router, mut to_router) = router.into_split();
    let back = tokio::spawn(async move {
        let _ = tokio::io::copy(&mut from_router, &mut to_robot).await;
    });
    let mut buffer = vec![0; 16_384];
    let mut left = PART;
    let mut passed = 0;
    while left > 0 {
        let read = tokio::select! {
            read = from_robot.read(&mut buffer) => read.unwrap(),
            _ = cut.changed() => continue,
        };
        if read == 0 {
            break;
        }
        let is_cut = *cut.borrow();
        let pass = if is_cut { read.min(left) } else { read };
        to_router.write_all(&buffer[..pass]).await.unwrap();
        if is_cut {
            left -= pass;
            passed += pass;
        }
    }
    back.abort();
    passed
}

#[tokio::test(flavor = "multi_thread")]
async fn half_a_frame_is_no_frame() {
    let router = Router::start();
    let (server, client) = start_on(&router, |_| {}).await;
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let url = format!("zenoh+tcp://{}", listener.local_addr().unwrap());
    let (cut, is_cut) = tokio::sync::watch::channel(false);
    let line = tokio::spawn(line(listener, router.address().to_owned(), is_cut));
    let mut doomed = Robot::connect(&url, "ada").await;
    doomed.put(0).await;
    assert_eq!(doomed.verdict().await.status(), FrameStatus::Integrated);
    cut.send_replace(true);
    // Of noise, so that it takes its place on the line: the head is good, and the rest is what is cut.
    let mut frame = crate::server::good_frame(1);
    (frame.robot_id, frame.sensor_id) = ("ada".into(), "front".into());
    if let Some(depth) = &mut frame.depth {
        depth.data =
            (0..2_000_000u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    }
    doomed.put_message(&frame).await;
    assert_eq!(line.await.unwrap(), PART, "it was cut in the middle of a frame");
    let mut other = Robot::connect(&router.url(), "bob").await;
    other.put(0).await;
    assert_eq!(other.verdict().await.status(), FrameStatus::Integrated);
    let counts = client.map_stats(DEFAULT_MAP).await.unwrap().counts;
    assert_eq!((counts.received, counts.integrated), (2, 2), "{counts:?}");
    // Its power is back.
    let mut again = Robot::connect(&router.url(), "ada").await;
    again.put(5).await;
    assert_eq!(again.verdict().await.status(), FrameStatus::Integrated);
    drop((doomed, other, again, client));
    server.stop().await.0.unwrap();
    drop(ZenohClient::connect(&router.url()).await.expect("the router is well"));
}
