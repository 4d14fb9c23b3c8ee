//! From settings to an open session.

use std::sync::Arc;
use std::time::Duration;

use zenoh::config::Config;

use super::options::{is_client, options};
use super::{Bus, Keys};
use crate::config::BusConfig;
use crate::error::{Error, Result};

/// How long a router may be away before somebody is told.
const PATIENCE: Duration = Duration::from_secs(2);

/// A session on its way.
pub struct Joining {
    config: Arc<BusConfig>,
    stage: Stage,
}

enum Stage {
    /// Connects to a router, which may be started later than we are.
    Waiting(Box<Config>),
    Open(zenoh::Session),
}

impl Joining {
    /// Checks settings and files. Peers and routers listen at once, so that a port that is taken is
    /// found at the start; a client waits for its router in [`Joining::joined`].
    pub async fn begin(config: &BusConfig) -> Result<Self> {
        let options = options(config)?;
        let stage = match is_client(&options) {
            true => Stage::Waiting(Box::new(options)),
            false => Stage::Open(open(options).await?),
        };
        Ok(Self { config: Arc::new(config.clone()), stage })
    }

    /// The open session; of a client, once its router is there.
    pub async fn joined(self) -> Result<Bus> {
        let session = match self.stage {
            Stage::Open(session) => session,
            Stage::Waiting(options) => {
                let mut opening = std::pin::pin!(open(*options));
                match tokio::time::timeout(PATIENCE, &mut opening).await {
                    Ok(opened) => opened?,
                    Err(_) => {
                        let at = self.config.connect.join(", ");
                        tracing::warn!("no Zenoh router answers yet ({at}); trying on");
                        opening.await?
                    }
                }
            }
        };
        let keys = Arc::new(Keys::new(&self.config.prefix));
        tracing::info!("joined Zenoh as {}", session.zid());
        Ok(Bus { session, keys, config: self.config })
    }
}

async fn open(options: Config) -> Result<zenoh::Session> {
    zenoh::open(options).await.map_err(|e| Error::Unavailable(format!("zenoh: {e}")))
}
