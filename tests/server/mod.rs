//! A whole server on a free port, asked through gRPC.

mod bad_input;
mod crash;
mod edits;
mod frames;
pub(crate) mod images;
mod journal;
pub(crate) mod language;
mod lifecycle;
mod maps;
mod mirror;
pub(crate) mod planner;
mod questions;
mod sensors;
mod snapshots;
mod streams;
mod zenoh;

use std::sync::Arc;

use orenx::client::Client;
use orenx::config::{MapSettings, ServerConfig, Settings};
use orenx::dataset::Dataset;
use orenx::dataset::synthetic::Synthetic;
use orenx::engine::QueuePolicy;
use orenx::error::Result;
use orenx::serve::Listeners;
use orenx::service::{DEFAULT_MAP, Mappers, Service};
use orenx::wire::{frame_to_wire, v1};
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinHandle;
use tokio_stream::wrappers::ReceiverStream;
use tonic::Streaming;
use tonic::transport::Channel;

/// A running server, its way down, and a connection to it.
pub(crate) struct Running {
    pub(crate) url: String,
    /// Host and port of HTTP.
    pub(crate) http: String,
    pub(crate) client: Client,
    pub(crate) channel: Channel,
    pub(crate) service: Arc<Service>,
    bare: Bare,
}

impl Running {
    /// Host and port of gRPC.
    pub(crate) fn bare_grpc(&self) -> &str {
        &self.bare.grpc
    }

    /// Ends the server as Ctrl-C would; what `serve::run` and the mapper thread said.
    pub(crate) async fn stop(self) -> (Result<()>, Result<()>) {
        self.bare.stop().await
    }
}

/// A running server that nobody is connected to.
pub(crate) struct Bare {
    /// Host and port of gRPC and of HTTP.
    pub(crate) grpc: String,
    pub(crate) http: String,
    pub(crate) service: Arc<Service>,
    mappers: Mappers,
    shutdown: oneshot::Sender<()>,
    serving: JoinHandle<Result<()>>,
}

impl Bare {
    /// Ends the server as Ctrl-C would; what `serve::run` and the mapper thread said.
    pub(crate) async fn stop(self) -> (Result<()>, Result<()>) {
        let _ = self.shutdown.send(());
        let served = self.serving.await.unwrap();
        (served, self.mappers.stop())
    }
}

/// A server with the defaults, except for `change`, and a map in memory. Its map is of the `fixed`
/// schedule and untrained, so that a test takes no longer than its frames.
pub(crate) async fn start(change: impl FnOnce(&mut Settings)) -> Running {
    let bare = bare(change).await;
    let url = format!("http://{}", bare.grpc);
    let client = Client::connect(&url).await.unwrap();
    let channel = Channel::from_shared(url.clone()).unwrap().connect().await.unwrap();
    let (http, service) = (bare.http.clone(), bare.service.clone());
    Running { url, http, client, channel, service, bare }
}

/// The same, without the connections.
pub(crate) async fn bare(change: impl FnOnce(&mut Settings)) -> Bare {
    let mut settings = Settings {
        map: MapSettings { steps: Some(0), ..MapSettings::default() },
        ..Settings::default()
    };
    settings.storage.path = "".into();
    settings.server.grpc = "127.0.0.1:0".into();
    settings.server.http = "127.0.0.1:0".into();
    change(&mut settings);
    let (config, map) = ServerConfig::from_settings(&settings).unwrap();
    let listeners = Listeners::bind(&config).await.unwrap();
    let grpc = listeners.grpc_address().unwrap().to_string();
    let http = listeners.http_address().unwrap().to_string();
    let (service, mappers) = Service::start(&config, map).unwrap();
    let (shutdown, stopped) = oneshot::channel::<()>();
    let serving = tokio::spawn(orenx::serve::run(listeners, service.clone(), async {
        let _ = stopped.await;
    }));
    Bare { grpc, http, service, mappers, shutdown, serving }
}

/// A good frame of a small room, as a message.
pub(crate) fn good_frame(seq: u64) -> v1::Frame {
    let room = Synthetic::room(100).with_width(64);
    let mut frame = room.load(seq as usize % 100, true).unwrap();
    frame.seq = seq;
    frame_to_wire(DEFAULT_MAP, &frame, QueuePolicy::Block)
}

/// A stream of frames and its acks.
pub(crate) async fn open_stream(
    channel: &Channel,
) -> (mpsc::Sender<v1::Frame>, Streaming<v1::FrameAck>) {
    let (frames, outgoing) = mpsc::channel(4);
    let acks = v1::ingest_client::IngestClient::new(channel.clone())
        .max_encoding_message_size(256 << 20)
        .stream_frames(ReceiverStream::new(outgoing))
        .await
        .unwrap();
    (frames, acks.into_inner())
}

/// The next ack that is a verdict.
pub(crate) async fn verdict(acks: &mut Streaming<v1::FrameAck>) -> v1::FrameAck {
    loop {
        let ack = acks.message().await.unwrap().expect("an ack");
        if !matches!(ack.status(), v1::FrameStatus::Accepted | v1::FrameStatus::Durable) {
            return ack;
        }
    }
}
