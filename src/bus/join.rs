//! From settings to an open session.

use std::sync::Arc;
use std::time::Duration;

use zenoh::Wait;
use zenoh::config::Config;

use super::options::{is_client, options};
use super::{Bus, Keys};
use crate::config::BusConfig;
use crate::error::{Error, Result};

/// The pause between two attempts to reach a router; each takes a while by itself.
const PAUSE: Duration = Duration::from_millis(250);

/// A session on its way.
pub struct Joining {
    config: Arc<BusConfig>,
    stage: Stage,
}

enum Stage {
    /// Connects to a router, which may be started later than we are.
    Waiting(Config),
    Open(zenoh::Session),
}

impl Joining {
    /// Checks settings and files. Peers and routers listen at once, so that a port that is taken is
    /// found at the start; a client waits for its router in [`Joining::joined`].
    pub async fn begin(config: &BusConfig) -> Result<Self> {
        let options = options(config)?;
        let stage = match is_client(&options) {
            true => Stage::Waiting(options),
            false => Stage::Open(open(options).await?),
        };
        Ok(Self { config: Arc::new(config.clone()), stage })
    }

    /// The open session; of a client, once its router is there, however long that takes.
    pub async fn joined(self) -> Result<Bus> {
        let session = match self.stage {
            Stage::Open(session) => session,
            Stage::Waiting(options) => in_the_end(options).await,
        };
        Ok(bus(session, self.config))
    }

    /// The same, if the router is there now.
    pub async fn joined_now(self) -> Result<Bus> {
        let session = match self.stage {
            Stage::Open(session) => session,
            Stage::Waiting(options) => open(options).await?,
        };
        Ok(bus(session, self.config))
    }
}

fn bus(session: zenoh::Session, config: Arc<BusConfig>) -> Bus {
    tracing::info!("joined Zenoh as {}", session.zid());
    Bus { session, keys: Arc::new(Keys::new(&config.prefix)), config }
}

/// Tries until it works; says so once if it does not at first.
async fn in_the_end(options: Config) -> zenoh::Session {
    let mut is_told = false;
    loop {
        match open(options.clone()).await {
            Ok(session) => return session,
            Err(error) if is_told => tracing::debug!("{error}"),
            Err(error) => tracing::warn!("{error}; trying on"),
        }
        is_told = true;
        tokio::time::sleep(PAUSE).await;
    }
}

/// Opening blocks its thread, for as long as a connection may take (`options`), whatever its future
/// says.
async fn open(options: Config) -> Result<zenoh::Session> {
    let opening = tokio::task::spawn_blocking(move || zenoh::open(options).wait());
    let opened = opening.await.map_err(|e| Error::Internal(format!("opening Zenoh: {e}")))?;
    opened.map_err(|e| Error::Unavailable(format!("Zenoh does not open: {e}")))
}
