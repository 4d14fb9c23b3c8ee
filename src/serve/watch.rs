//! News of watches as messages, for the transports that send those.

use prost::Message;

use crate::error::Result;
use crate::service::{RegionWatch, TrajectoryWatch};
use crate::wire::{region_change_to_wire, trajectories_reply_to_wire, v1};

/// What has news.
pub(super) trait Watch: Send + 'static {
    type News: Message + Send + 'static;
    /// What kind of message they are, in `orenx.v1`.
    const KIND: &'static str;

    /// The next news; `None` after the last.
    fn news(&mut self) -> impl Future<Output = Result<Option<Self::News>>> + Send;
}

impl Watch for RegionWatch {
    type News = v1::WatchRegionReply;
    const KIND: &'static str = "WatchRegionReply";

    async fn news(&mut self) -> Result<Option<v1::WatchRegionReply>> {
        let change = self.next().await?;
        Ok(change.map(|change| region_change_to_wire(&self.shape(), self.told(), change)))
    }
}

impl Watch for TrajectoryWatch {
    type News = v1::WatchTrajectoryReply;
    const KIND: &'static str = "WatchTrajectoryReply";

    async fn news(&mut self) -> Result<Option<v1::WatchTrajectoryReply>> {
        let result = self.next().await?.map(trajectories_reply_to_wire);
        let seq = self.told();
        Ok(result.map(|result| v1::WatchTrajectoryReply { result: Some(result), seq }))
    }
}
