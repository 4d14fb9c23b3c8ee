//! A server without ports, with a small map, for each thread that asks.

use std::cell::{Cell, RefCell};
use std::sync::Arc;

use axum::Router;
use orenx::config::{ServerConfig, Settings};
use orenx::engine::QueuePolicy;
use orenx::serve::http_routes;
use orenx::service::{Mappers, Service};
use orenx::wire::{IncomingFrame, frame_to_wire};
use tokio::runtime::{Builder, Runtime};

use super::{ask, scene};

/// What is asked.
pub(super) struct Server {
    runtime: Runtime,
    pub(super) service: Arc<Service>,
    pub(super) routes: Router,
    mappers: Option<Mappers>,
}

thread_local! {
    static SERVER: RefCell<Option<Server>> = const { RefCell::new(None) };
}

/// Asks the server of this thread, which is started first where there is none.
pub(super) fn with<T>(ask: impl FnOnce(&Server) -> T) -> T {
    let server = SERVER.take().unwrap_or_else(Server::start);
    let answer = ask(&server);
    if CHANGES.get() < MOST_CHANGES {
        SERVER.set(Some(server));
    } else {
        CHANGES.set(0);
    }
    answer
}

/// Changes that a map sees before it gives way to a new one. Starting a server takes longer than a
/// thousand questions.
const MOST_CHANGES: u32 = 32;

thread_local! {
    static CHANGES: Cell<u32> = const { Cell::new(0) };
}

/// The map has changed.
pub(super) fn note_change() {
    CHANGES.set(CHANGES.get() + 1);
}

impl Server {
    fn start() -> Self {
        let mut settings = Settings { map: scene::settings(), ..Settings::default() };
        settings.storage.path = "".into();
        settings.server.max_maps = 2;
        settings.server.max_points = 1000;
        settings.server.max_pixels = 4096;
        settings.server.query_threads = 1;
        // An input must not wait for what else the machine does.
        settings.server.trainer_nice = 0;
        settings.server.publish_interval_ms = 0;
        settings.map.steps = Some(0);
        let (config, map) = ServerConfig::from_settings(&settings).unwrap();
        let runtime = Builder::new_current_thread().enable_all().build().unwrap();
        let (service, mappers) = Service::start(&config, map).unwrap();
        let routes = runtime.block_on(async { http_routes(service.clone(), &config) }).unwrap();
        let server = Self { runtime, service, routes, mappers: Some(mappers) };
        let message = frame_to_wire("default", &scene::frame(10), QueuePolicy::Block);
        ask::submit(&server, IncomingFrame::try_from(message).unwrap()).unwrap();
        server
    }

    /// Waits for an answer.
    pub(super) fn wait<T>(&self, answer: impl Future<Output = T>) -> T {
        self.runtime.block_on(answer)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        if let Some(mappers) = self.mappers.take() {
            mappers.stop().expect("the map's thread never failed");
        }
    }
}
