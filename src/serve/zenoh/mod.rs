//! The server on Zenoh, from its first connection to its way down: frames in, questions answered, the
//! state of the map and slices of it said again and again, and a token that lives as long as all of it.

mod questions;
mod said;
mod tally;
mod verbs;

use std::sync::Arc;

use tokio::sync::watch;

use super::ros2::Robot;
use crate::bus::{Bus, Joining, bus_error};
use crate::config::Ros2Config;
use crate::error::Result;
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
        let served = serve_on(&bus, ros2.as_ref(), &service, &tally, &mut closing).await;
        tally.leave();
        bus.close().await;
        served
    };
    if let Err(error) = served.await {
        tracing::error!("no Zenoh: {error}");
    }
}

async fn serve_on(
    bus: &Bus,
    ros2: Option<&Ros2Config>,
    service: &Arc<Service>,
    tally: &Arc<Tally>,
    closing: &mut watch::Receiver<bool>,
) -> Result<()> {
    let frames = FrameSubscriber::declare(bus, service, DEFAULT_MAP, &tally.frames).await?;
    let questions = Questions::declare(bus, service, DEFAULT_MAP, tally).await?;
    let robot = match ros2 {
        Some(config) => Some(Robot::declare(bus, config, service, DEFAULT_MAP).await?),
        None => None,
    };
    // Last of all: who sees it may ask.
    let key = bus.keys().alive(DEFAULT_MAP, &bus.id());
    let token = bus.session().liveliness().declare_token(&key).await;
    let token = token.map_err(|e| bus_error(&key, &e))?;
    tally.join();
    let said = tokio::select! {
        said = say_all(bus, service, DEFAULT_MAP) => said,
        () = closed(closing) => Ok(()),
    };
    if let Err(error) = token.undeclare().await {
        tracing::debug!("{key}: {error}");
    }
    drop(robot);
    frames.close().await;
    questions.close().await;
    said
}

/// Waits until the server closes. An error means that it is gone, and everything with it.
async fn closed(closing: &mut watch::Receiver<bool>) {
    let _ = closing.wait_for(|closing| *closing).await;
}
