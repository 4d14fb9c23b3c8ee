//! What happens to a map, as Server-Sent Events: its counters whenever they are new, a few times a
//! second at most.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::{RawQuery, State};
use axum::response::Response;
use serde_json::json;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};
use tokio::time::{Instant, sleep, sleep_until};

use super::Edge;
use super::maps::stats_of;
use super::openapi::MapRefusals;
use super::options::decoded;
use super::refusal::Refusal;
use super::sse::{Event, Source, respond};
use crate::error::Error;
use crate::service::{DEFAULT_MAP, Service};

/// Listeners at a time.
const MAX_LISTENERS: usize = 64;
/// Between two events of one listener: pages need no more, and counters of 256 robots are long.
const LEAST_INTERVAL: Duration = Duration::from_millis(250);
/// Without an epoch counters are told as often as this: frames may be refused meanwhile, and a listener
/// sees that the server is there.
const MOST_INTERVAL: Duration = Duration::from_secs(1);

/// Places for listeners.
pub(super) fn places() -> Arc<Semaphore> {
    Arc::new(Semaphore::new(MAX_LISTENERS))
}

/// Which map is listened to; a key that does not exist, or twice, is refused.
#[derive(utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[expect(dead_code, reason = "stands for the query string in the document")]
pub(super) struct EventsQuery {
    /// The map; left out, "default".
    #[param(example = "default")]
    map: Option<String>,
}

/// What happens to a map, as Server-Sent Events
///
/// `status`: the counters as `/v1/maps/{map}/stats` has them, at once, with each new epoch but at most
/// four times a second, and once a second in any case; `end`: the server stops, or the map was deleted,
/// with the reason, and nothing follows. Who reads slowly misses events, and holds up nobody. At most 64
/// listen at a time.
#[utoipa::path(get, path = "/v1/events", tag = "maps",
    params(EventsQuery),
    responses((status = 200, description = "Events, for as long as the client listens.",
        body = String, content_type = "text/event-stream"), MapRefusals))]
pub(super) async fn events(
    State(edge): State<Arc<Edge>>,
    RawQuery(query): RawQuery,
) -> Result<Response, Refusal> {
    let service = edge.service()?.clone();
    let map_id = map_of(query.as_deref())?;
    service.map_detail(&map_id)?;
    let place = edge.listeners.clone().try_acquire_owned().map_err(|_| {
        let limit = format!("the limit is {MAX_LISTENERS}");
        Refusal::from(Error::ResourceExhausted { what: "listeners to events".into(), limit })
    })?;
    let ending = edge.ending.subscribe();
    Ok(respond(Listener { service, map_id, ending, told: None, is_over: false, _place: place }))
}

fn map_of(query: Option<&str>) -> Result<String, Refusal> {
    let mut map_id = None;
    for pair in query.unwrap_or_default().split('&').filter(|pair| !pair.is_empty()) {
        let (key, value) = pair.split_once('=').unwrap_or((pair, ""));
        let key = decoded(key)?;
        if key != "map" {
            let shown: String = key.chars().take(64).collect();
            return Err(Error::invalid(shown, "is not map").into());
        }
        if map_id.replace(decoded(value)?).is_some() {
            return Err(Error::invalid(key, "is there twice").into());
        }
    }
    Ok(map_id.unwrap_or_else(|| DEFAULT_MAP.into()))
}

/// Who listens to a map.
struct Listener {
    service: Arc<Service>,
    map_id: String,
    /// Turns true when the server stops.
    ending: watch::Receiver<bool>,
    /// The epoch of the last event, and the earliest time of the next.
    told: Option<(u64, Instant)>,
    is_over: bool,
    _place: OwnedSemaphorePermit,
}

impl Source for Listener {
    async fn next(&mut self) -> Result<Option<Event>, Refusal> {
        if self.is_over {
            return Ok(None);
        }
        let Self { service, map_id, ending, told, is_over, .. } = self;
        let news = async {
            let Some((epoch, earliest)) = *told else { return };
            tokio::select! {
                _ = service.has_news(map_id, Some(epoch)) => {}
                () = sleep(MOST_INTERVAL) => {}
            }
            sleep_until(earliest).await;
        };
        let over = tokio::select! {
            () = news => None,
            _ = ending.wait_for(|ending| *ending) => Some("the server is stopping"),
        };
        let stats = stats_of(service, map_id);
        let (epoch, name, data) = match (over, stats) {
            (None, Ok(stats)) => (stats.epoch(), "status", serde_json::to_vec(&stats)),
            (over, stats) => {
                *is_over = true;
                let reason = json!({ "reason": over.unwrap_or("the map is gone") });
                (stats.map_or(0, |stats| stats.epoch()), "end", serde_json::to_vec(&reason))
            }
        };
        *told = Some((epoch, Instant::now() + LEAST_INTERVAL));
        let data =
            data.map_err(|e| Error::Internal(format!("an event did not become JSON: {e}")))?;
        Ok(Some(Event::new(name, epoch, &data, None)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_map_is_named_once_or_is_the_default() {
        assert_eq!(map_of(None).expect("nothing"), "default");
        assert_eq!(map_of(Some("map=hall%20two")).expect("a map"), "hall two");
        for (query, part) in [("maps=a", "is not map"), ("map=a&map=b", "twice")] {
            let problem = format!("{:?}", map_of(Some(query)).expect_err(query));
            assert!(problem.contains(part), "{problem}");
        }
    }
}
