//! The server on Zenoh, from its first connection to its way down: frames in, questions answered, the
//! state of the map and slices of it said again and again, and a token that lives as long as all of it.

mod questions;
mod said;
mod tally;
mod verbs;
mod watches;

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::sync::Arc;

use tokio::sync::{oneshot, watch};
use tokio::task::JoinSet;

use super::ros2::Robot;
use crate::bus::{Bus, Joining, bus_error};
use crate::config::Ros2Config;
use crate::error::{Error, Result};
use crate::ingest::FrameSubscriber;
use crate::service::{DEFAULT_MAP, Service};
use questions::Questions;
use said::say_all;
pub(super) use tally::Tally;

/// Serves until `closing` turns true. A failure is told and counted out: the server's other transports
/// go on.
pub(super) async fn serve(
    joining: Joining,
    ros2: Option<Ros2Config>,
    service: Arc<Service>,
    tally: Arc<Tally>,
    mut closing: watch::Receiver<bool>,
) {
    let joined = tokio::select! {
        joined = joining.joined() => joined,
        () = closed(&mut closing) => return,
    };
    let served = async {
        let bus = joined?;
        serve_on(&bus, ros2.as_ref(), &service, &tally, &mut closing).await;
        tally.leave();
        bus.close().await;
        Ok::<(), Error>(())
    };
    if let Err(error) = served.await {
        tracing::error!("no Zenoh: {error}");
    }
}

/// Serves every map that there is, as maps come and go.
async fn serve_on(
    bus: &Bus,
    ros2: Option<&Ros2Config>,
    service: &Arc<Service>,
    tally: &Arc<Tally>,
    closing: &mut watch::Receiver<bool>,
) {
    let mut ids = service.map_ids();
    // A map is served until its sender is dropped.
    let mut served = BTreeMap::<String, oneshot::Sender<()>>::new();
    let mut maps = JoinSet::new();
    loop {
        let wanted = ids.borrow_and_update().clone();
        served.retain(|id, _| wanted.contains(id));
        for id in wanted {
            if let Entry::Vacant(place) = served.entry(id) {
                let (stop, stopped) = oneshot::channel();
                maps.spawn(OnBus::of(place.key(), bus, ros2, service, tally).serve(stopped));
                place.insert(stop);
            }
        }
        tokio::select! {
            // Its sender is the service's own.
            _ = ids.changed() => {}
            Some(_) = maps.join_next() => {}
            () = closed(closing) => break,
        }
    }
    drop(served);
    maps.join_all().await;
}

/// One map on the bus.
struct OnBus {
    map_id: String,
    bus: Bus,
    /// If robots of ROS 2 work on this map.
    ros2: Option<Ros2Config>,
    service: Arc<Service>,
    tally: Arc<Tally>,
}

impl OnBus {
    fn of(
        map_id: &str,
        bus: &Bus,
        ros2: Option<&Ros2Config>,
        service: &Arc<Service>,
        tally: &Arc<Tally>,
    ) -> Self {
        Self {
            map_id: map_id.to_owned(),
            bus: bus.clone(),
            ros2: ros2.filter(|_| map_id == DEFAULT_MAP).cloned(),
            service: service.clone(),
            tally: tally.clone(),
        }
    }

    /// Serves until `stopped`. A failure is told: the other maps go on.
    async fn serve(self, stopped: oneshot::Receiver<()>) {
        if let Err(error) = self.try_serve(stopped).await {
            tracing::error!("map '{}' is not served over Zenoh: {error}", self.map_id);
        }
    }

    async fn try_serve(&self, stopped: oneshot::Receiver<()>) -> Result<()> {
        let Self { map_id, bus, ros2, service, tally } = self;
        let frames = FrameSubscriber::declare(bus, service, map_id, &tally.frames).await?;
        let questions = Questions::declare(bus, service, map_id, tally).await?;
        let robot = match ros2 {
            Some(config) => Some(Robot::declare(bus, config, service, map_id).await?),
            None => None,
        };
        // Last of all: who sees it may ask.
        let key = bus.keys().alive(map_id, &bus.id());
        let token = bus.session().liveliness().declare_token(&key).await;
        let token = token.map_err(|e| bus_error(&key, &e))?;
        tally.join();
        let said = tokio::select! {
            said = say_all(bus, service, map_id) => said,
            _ = stopped => Ok(()),
        };
        if let Err(error) = token.undeclare().await {
            tracing::debug!("{key}: {error}");
        }
        drop(robot);
        frames.close().await;
        questions.close().await;
        said
    }
}

/// Waits until the server closes. An error means that it is gone, and everything with it.
async fn closed(closing: &mut watch::Receiver<bool>) {
    let _ = closing.wait_for(|closing| *closing).await;
}
