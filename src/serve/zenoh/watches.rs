//! What is watched over Zenoh. A question begins a watch and is told a key; what is new is said there
//! from the first subscriber on, until the last one is gone.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use bytes::Buf;
use prost::Message;
use tokio::sync::watch;
use tokio::task::JoinSet;
use zenoh::Wait;
use zenoh::bytes::Encoding;
use zenoh::matching::{MatchingListener, MatchingStatus};
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};

use super::verbs::Answer;
use crate::bus::{Bus, bus_error, encoding_of};
use crate::error::{Error, Result};
use crate::serve::watch::Watch;
use crate::service::{RegionQuestion, Service, WatchedTrajectories};
use crate::wire::{read_message, refusal_to_wire, settle_name, v1};

/// How long the first subscriber may take.
const PATIENCE: Duration = Duration::from_secs(10);

/// The watches of one map, until dropped; the service bounds those of all transports together.
pub(super) struct Watches {
    bus: Bus,
    map_id: String,
    begun: AtomicU64,
    closing: watch::Sender<bool>,
    tasks: Mutex<JoinSet<()>>,
}

impl Watches {
    pub(super) fn new(bus: &Bus, map_id: &str) -> Self {
        Self {
            bus: bus.clone(),
            map_id: map_id.into(),
            begun: AtomicU64::new(1),
            closing: watch::Sender::new(false),
            tasks: Mutex::default(),
        }
    }

    /// Begins what a verb says; `None` if it begins nothing.
    pub(super) async fn begin(
        &self,
        service: &Arc<Service>,
        verb: &str,
        payload: impl Buf,
    ) -> Option<Result<Answer>> {
        let begun = match verb {
            "watch_region" => {
                let watch = read_message(payload).and_then(|mut asked: v1::WatchRegionRequest| {
                    settle_name("map_id", &mut asked.map_id, &self.map_id)?;
                    service.watch_region(RegionQuestion::try_from(asked)?)
                });
                self.follow(watch).await
            }
            "watch_trajectories" => {
                let watch =
                    read_message(payload).and_then(|mut asked: v1::WatchTrajectoryRequest| {
                        if let Some(check) = &mut asked.check {
                            settle_name("check.map_id", &mut check.map_id, &self.map_id)?;
                        }
                        service.watch_trajectories(WatchedTrajectories::try_from(asked)?)
                    });
                self.follow(watch).await
            }
            _ => return None,
        };
        Some(begun.map(|reply| Answer { message: "WatchReply", bytes: reply.encode_to_vec() }))
    }

    /// Lets those whose map has ended say so for a little while, and ends all of them.
    pub(super) async fn close(&self, patience: Duration) {
        self.closing.send_replace(true);
        let tasks = std::mem::take(&mut *self.tasks.lock().unwrap_or_else(PoisonError::into_inner));
        // Those that are left end with their set.
        if tokio::time::timeout(patience, tasks.join_all()).await.is_err() {
            tracing::debug!("some watches over Zenoh did not end within {patience:?}");
        }
    }

    async fn follow<W: Watch>(&self, watch: Result<W>) -> Result<v1::WatchReply> {
        let watch = watch?;
        // Of this server's session, so that nobody listens by chance to one of its predecessor.
        let id = format!("{}-{}", self.bus.id(), self.begun.fetch_add(1, Relaxed));
        let key = self.bus.keys().watch(&self.map_id, &id);
        let publisher = self
            .bus
            .session()
            .declare_publisher(key.clone())
            .encoding(encoding_of(W::KIND))
            // What is lost of news that build on each other would be missed for good.
            .congestion_control(CongestionControl::Block)
            .priority(Priority::DataHigh)
            .await
            .map_err(|e| bus_error(&key, &e))?;
        let outlet = Outlet::new(publisher).await.map_err(|e| bus_error(&key, &e))?;
        let mut tasks = self.tasks.lock().unwrap_or_else(PoisonError::into_inner);
        while tasks.try_join_next().is_some() {}
        tasks.spawn(tell(watch, outlet, self.closing.subscribe()));
        Ok(v1::WatchReply { id, key })
    }
}

/// Where news are said, and whether anybody listens.
struct Outlet {
    publisher: Arc<Publisher<'static>>,
    heard: watch::Receiver<bool>,
    _listener: MatchingListener<()>,
}

impl Outlet {
    async fn new(publisher: Publisher<'static>) -> zenoh::Result<Self> {
        let (tell, heard) = watch::channel(false);
        let told = tell.clone();
        let callback = move |status: MatchingStatus| {
            told.send_replace(status.matching());
        };
        let listener = publisher.matching_listener().callback(callback).await?;
        // Who came before the listener is not told of.
        if publisher.matching_status().await?.matching() {
            tell.send_replace(true);
        }
        Ok(Self { publisher: Arc::new(publisher), heard, _listener: listener })
    }

    /// Waits until somebody listens, or nobody does any more.
    async fn turns(&mut self, heard: bool) {
        // The sender lives as long as the listener.
        let _ = self.heard.wait_for(|is| *is == heard).await;
    }

    /// Says it; it waits where the line is full, and so goes to a thread that may.
    async fn say(&self, kind: Option<Encoding>, payload: Vec<u8>) {
        let publisher = self.publisher.clone();
        let said = tokio::task::spawn_blocking(move || {
            let put = publisher.put(payload);
            match kind {
                Some(kind) => put.encoding(kind).wait(),
                None => put.wait(),
            }
        });
        if let Ok(Err(error)) = said.await {
            tracing::debug!("{}: {error}", self.publisher.key_expr());
        }
    }
}

/// Says what is new while somebody listens. A deletion of the key is the end.
async fn tell<W: Watch>(mut watch: W, mut outlet: Outlet, mut closing: watch::Receiver<bool>) {
    tokio::select! {
        () = outlet.turns(true) => {}
        () = tokio::time::sleep(PATIENCE) => return,
        _ = closing.wait_for(|closing| *closing) => return,
    }
    let error = loop {
        let next = tokio::select! {
            next = watch.news() => next,
            () = outlet.turns(false) => return,
        };
        match next {
            Ok(Some(news)) => outlet.say(None, news.encode_to_vec()).await,
            Ok(None) => break Error::Unavailable("the map has ended".into()),
            Err(error) => break error,
        }
    };
    let refusal = refusal_to_wire(&error).encode_to_vec();
    outlet.say(Some(encoding_of("QueryError")), refusal).await;
    if let Err(error) = outlet.publisher.delete().await {
        tracing::debug!("{}: {error}", outlet.publisher.key_expr());
    }
}
