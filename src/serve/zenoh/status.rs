//! The state of a map, said again and again: `<prefix>/<map>/out/status`.

use std::time::Instant;

use prost::Message;
use tokio::time::MissedTickBehavior;
use zenoh::qos::{CongestionControl, Priority};
use zenoh_ext::{AdvancedPublisherBuilderExt, CacheConfig, MissDetectionConfig};

use crate::bus::{Bus, bus_error, encoding_of};
use crate::error::Result;
use crate::service::Service;
use crate::wire::map_stats_to_wire;

/// Says it until dropped; an error if it cannot be said at all. Who comes later is told the last one
/// at once, if it subscribes with history; a line that is full loses it.
pub(super) async fn say_status(bus: &Bus, service: &Service, map_id: &str) -> Result<()> {
    let key = bus.keys().status(map_id);
    let publisher = bus
        .session()
        .declare_publisher(&key)
        .encoding(encoding_of("GetMapStatsReply"))
        .congestion_control(CongestionControl::Drop)
        .priority(Priority::DataLow)
        .cache(CacheConfig::default().max_samples(1))
        .sample_miss_detection(MissDetectionConfig::default())
        .publisher_detection()
        .await
        .map_err(|e| bus_error(&key, &e))?;
    let mut clock = tokio::time::interval(bus.config().status_interval);
    clock.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        clock.tick().await;
        let started = Instant::now();
        let report = service.map_stats(map_id)?;
        let status = map_stats_to_wire(report, started.elapsed());
        if let Err(error) = publisher.put(status.encode_to_vec()).await {
            tracing::debug!("{key}: {error}");
        }
    }
}
