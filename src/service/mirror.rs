//! Views for those who follow a map in another process.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::Instant;

use super::Service;
use crate::engine::Handle;
use crate::error::{Error, Result};
use crate::map::MapView;

/// Readers at a time. Each holds on to the pages of the view that it was told last: at worst a copy of
/// the map for all readers of the same speed.
const MAX_MIRRORS: usize = 16;
/// The slowest that a reader may follow.
const MAX_INTERVAL: Duration = Duration::from_secs(60);

/// Places for readers.
pub(super) fn places() -> Arc<Semaphore> {
    Arc::new(Semaphore::new(MAX_MIRRORS))
}

/// One reader's way through the views of a map.
pub struct Follower {
    mapper: Handle,
    told: Option<Arc<MapView>>,
    min_interval: Duration,
    told_at: Option<Instant>,
    _place: OwnedSemaphorePermit,
}

impl Service {
    /// A place among those who follow a map, with at most one view in `min_interval`.
    pub fn follow(&self, map_id: &str, min_interval: Duration) -> Result<Follower> {
        let mapper = self.map(map_id)?;
        if min_interval > MAX_INTERVAL {
            let (ms, most) = (min_interval.as_millis(), MAX_INTERVAL.as_millis());
            return Err(Error::invalid("min_interval_ms", format!("{ms}; the limit is {most}")));
        }
        let full = |_| Error::ResourceExhausted {
            what: "mirrors".into(),
            limit: format!("{MAX_MIRRORS} at a time"),
        };
        let place = self.mirrors.clone().try_acquire_owned().map_err(full)?;
        Ok(Follower { mapper, told: None, min_interval, told_at: None, _place: place })
    }
}

impl Follower {
    /// The newest view, once it is another than the last one, and that one; `None` once the map is
    /// closed.
    pub async fn next(&mut self) -> Option<(Arc<MapView>, Option<Arc<MapView>>)> {
        if let Some(at) = self.told_at {
            tokio::time::sleep_until(at + self.min_interval).await;
        }
        let view = match &self.told {
            None => self.mapper.published().view,
            Some(told) => self.mapper.published_after(told.epoch()).await?.view,
        };
        self.told_at = Some(Instant::now());
        let old = self.told.replace(view.clone());
        Some((view, old))
    }
}
