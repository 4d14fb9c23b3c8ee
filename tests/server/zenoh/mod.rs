//! The same server over Zenoh, with a router in a process of its own.

mod bad_input;
mod cut;
mod esdf;
mod fleet;
mod life;
mod ros2;
mod router;
mod secure;
mod shot;
mod verbs;
mod watches;
mod words;

use orenx::bus::{FrameKey, Slices, encoding_of};
use orenx::client::ZenohClient;
use orenx::config::Settings;
use orenx::service::DEFAULT_MAP;
use orenx::wire::{read_message, v1};
use prost::Message;
use tokio::sync::mpsc;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber;
use zenoh::sample::{Sample, SampleKind};

use super::{Running, good_frame, start};
use router::Router;

/// A server that is on the router's network, and a client that has seen it there.
async fn start_on(router: &Router, change: impl FnOnce(&mut Settings)) -> (Running, ZenohClient) {
    let server = start(|settings| {
        settings.bus.connect = vec![router.endpoint().to_owned()];
        change(settings);
    })
    .await;
    let client = ZenohClient::connect(&router.url()).await.unwrap();
    alive(&client).await.wait().await;
    (server, client)
}

/// Hears of servers that come and go.
struct Alive {
    tokens: mpsc::Receiver<SampleKind>,
    _subscriber: Subscriber<()>,
}

async fn alive(client: &ZenohClient) -> Alive {
    let (told, tokens) = mpsc::channel(64);
    let key = client.bus().keys().alive(DEFAULT_MAP, "*");
    let subscriber = client
        .bus()
        .session()
        .liveliness()
        .declare_subscriber(key)
        .history(true)
        .callback(move |sample: Sample| told.try_send(sample.kind()).unwrap())
        .await
        .unwrap();
    Alive { tokens, _subscriber: subscriber }
}

impl Alive {
    /// Waits until a server is there.
    async fn wait(&mut self) {
        while self.tokens.recv().await.unwrap() != SampleKind::Put {}
    }

    /// Waits until a server is gone.
    async fn wait_gone(&mut self) {
        while self.tokens.recv().await.unwrap() != SampleKind::Delete {}
    }
}

/// A robot that puts whatever it likes, and hears its acks.
struct Robot {
    client: ZenohClient,
    key: FrameKey,
    acks: mpsc::Receiver<v1::FrameAck>,
    _subscriber: Subscriber<()>,
    _token: Option<LivelinessToken>,
}

impl Robot {
    async fn connect(url: &str, name: &str) -> Self {
        let client = ZenohClient::connect(url).await.unwrap();
        let key = FrameKey::new(name, "front").unwrap();
        let (told, acks) = mpsc::channel(1024);
        let subscriber = client
            .bus()
            .session()
            .declare_subscriber(client.bus().keys().ack(DEFAULT_MAP, &key))
            .callback(move |sample: Sample| {
                let _ = told.try_send(read_message(Slices::of(sample.payload())).unwrap());
            })
            .await
            .unwrap();
        Self { client, key, acks, _subscriber: subscriber, _token: None }
    }

    fn frame_key(&self) -> String {
        self.client.bus().keys().frame(DEFAULT_MAP, &self.key)
    }

    /// Puts a frame of the room under the robot's own name.
    async fn put(&self, seq: u64) {
        let mut frame = good_frame(seq);
        frame.robot_id.clear();
        frame.sensor_id.clear();
        self.put_message(&frame).await;
    }

    async fn put_message(&self, frame: &v1::Frame) {
        let session = self.client.bus().session();
        let put = session.put(self.frame_key(), frame.encode_to_vec());
        put.encoding(encoding_of("Frame")).await.unwrap();
    }

    /// The next ack that is a verdict.
    async fn verdict(&mut self) -> v1::FrameAck {
        loop {
            let ack = self.acks.recv().await.unwrap();
            if !matches!(ack.status(), v1::FrameStatus::Accepted | v1::FrameStatus::Durable) {
                return ack;
            }
        }
    }
}
