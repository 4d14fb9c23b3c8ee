//! What became of the requests, by route and status.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Instant;

use axum::http::StatusCode;

use super::ROUTES;
use crate::telemetry::{Distribution, Histogram};

/// The statuses that there are. The client of a 499 left before its answer, as nginx has it.
const STATUSES: [u16; 18] =
    [200, 201, 304, 400, 401, 403, 404, 405, 406, 408, 409, 413, 415, 429, 431, 499, 503, 504];
/// Everything else.
const OTHER: usize = STATUSES.len();
const CLIENT_LEFT: u16 = 499;

/// Counters of one port.
pub(super) struct Requests {
    /// One more than there are routes: for paths that are none.
    routes: [Route; ROUTES.len() + 1],
}

impl Default for Requests {
    fn default() -> Self {
        Self { routes: std::array::from_fn(|_| Route::default()) }
    }
}

#[derive(Default)]
struct Route {
    statuses: [AtomicU64; STATUSES.len() + 1],
    times: Histogram,
}

/// The requests of one route.
pub(super) struct RouteCounts {
    pub(super) route: &'static str,
    /// Those that occurred.
    pub(super) statuses: Vec<(u16, u64)>,
    pub(super) times: Distribution,
}

impl Requests {
    /// Starts the clock of a request.
    pub(super) fn begin(&self, route: Option<&str>) -> Count<'_> {
        let place = ROUTES.iter().position(|known| Some(*known) == route).unwrap_or(ROUTES.len());
        Count { route: &self.routes[place], begun: Instant::now(), status: CLIENT_LEFT }
    }

    pub(super) fn read(&self) -> Vec<RouteCounts> {
        let names = ROUTES.iter().copied().chain(["other"]);
        let read = |(route, counts): (&'static str, &Route)| {
            let all = STATUSES.iter().copied().chain([500]).zip(&counts.statuses);
            let statuses = all.map(|(status, count)| (status, count.load(Relaxed)));
            RouteCounts {
                route,
                statuses: statuses.filter(|(_, count)| *count > 0).collect(),
                times: counts.times.read(),
            }
        };
        names.zip(&self.routes).map(read).collect()
    }
}

/// A request under way; counted when it is dropped.
pub(super) struct Count<'a> {
    route: &'a Route,
    begun: Instant,
    status: u16,
}

impl Count<'_> {
    /// It has its answer.
    pub(super) fn end(mut self, status: StatusCode) {
        self.status = status.as_u16();
    }
}

impl Drop for Count<'_> {
    fn drop(&mut self) {
        let place = STATUSES.iter().position(|known| *known == self.status).unwrap_or(OTHER);
        self.route.statuses[place].fetch_add(1, Relaxed);
        self.route.times.observe(self.begun.elapsed());
    }
}
