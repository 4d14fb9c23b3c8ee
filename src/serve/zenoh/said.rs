//! What is said again and again, to whoever listens: the state of a map, and slices of it.

use std::sync::Arc;
use std::time::Duration;

use prost::Message;
use tokio::task::JoinSet;
use tokio::time::MissedTickBehavior;
use zenoh::qos::{CongestionControl, Priority};
use zenoh_ext::{AdvancedPublisher, AdvancedPublisherBuilderExt, CacheConfig, MissDetectionConfig};

use super::verbs::answer;
use crate::bus::{Bus, bus_error, encoding_of};
use crate::config::SliceConfig;
use crate::error::{Error, Result};
use crate::service::Service;
use crate::wire::v1;

/// Says everything until dropped; an error if something cannot be said at all.
pub(super) async fn say_all(bus: &Bus, service: &Arc<Service>, map_id: &str) -> Result<()> {
    let mut sayings = JoinSet::new();
    let status = v1::GetMapStatsRequest { map_id: map_id.into() };
    let mut all = vec![Saying {
        key: bus.keys().status(map_id),
        verb: "stats",
        reply: "GetMapStatsReply",
        asked: status.encode_to_vec(),
        interval: bus.config().status_interval,
    }];
    all.extend(bus.config().slices.iter().map(|slice| Saying::of_slice(bus, map_id, slice)));
    for saying in all {
        sayings.spawn(saying.go(bus.clone(), service.clone(), map_id.to_owned()));
    }
    // None of them ends by itself.
    match sayings.join_next().await {
        Some(Ok(ended)) => ended,
        _ => Err(Error::Internal("what is said over Zenoh ended".into())),
    }
}

/// The answer to one question, at its own pace.
struct Saying {
    key: String,
    verb: &'static str,
    reply: &'static str,
    asked: Vec<u8>,
    interval: Duration,
}

impl Saying {
    fn of_slice(bus: &Bus, map_id: &str, slice: &SliceConfig) -> Self {
        let costs = slice
            .costs
            .map(|(robot_radius_m, inflation_m)| v1::SliceCosts { robot_radius_m, inflation_m });
        let asked = v1::GetSliceRequest {
            map_id: map_id.into(),
            z_m: slice.z_m,
            z_max_m: slice.z_max_m,
            resolution_m: slice.resolution_m,
            costs,
            ..v1::GetSliceRequest::default()
        };
        Self {
            key: bus.keys().slice(map_id, &slice.name),
            verb: "slice",
            reply: "GetSliceReply",
            asked: asked.encode_to_vec(),
            interval: slice.interval,
        }
    }

    async fn go(self, bus: Bus, service: Arc<Service>, map_id: String) -> Result<()> {
        let publisher = self.publisher(&bus).await?;
        let mut clock = tokio::time::interval(self.interval);
        clock.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            clock.tick().await;
            // Of an empty map there is no slice, and what fails now may not the next time.
            match answer(&service, &map_id, self.verb, self.asked.as_slice()).await {
                Ok(said) => {
                    if let Err(error) = publisher.put(said.bytes).await {
                        tracing::debug!("{}: {error}", self.key);
                    }
                }
                Err(error) => tracing::debug!("{}: {error}", self.key),
            }
        }
    }

    /// Who comes later is told what was said last, if it subscribes with history; a line that is full
    /// loses it.
    async fn publisher(&self, bus: &Bus) -> Result<AdvancedPublisher<'static>> {
        bus.session()
            .declare_publisher(self.key.clone())
            .encoding(encoding_of(self.reply))
            .congestion_control(CongestionControl::Drop)
            .priority(Priority::DataLow)
            .cache(CacheConfig::default().max_samples(1))
            .sample_miss_detection(MissDetectionConfig::default())
            .publisher_detection()
            .await
            .map_err(|e| bus_error(&self.key, &e))
    }
}
