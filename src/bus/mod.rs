//! The Zenoh session: where it connects, and the keys that everything has on it.
//!
//! Who takes frames or answers questions over Zenoh is given an open [`Bus`] and declares what it
//! needs on its session. Declarations outlive a lost router: the session connects again by itself, and
//! says them anew.

mod join;
mod keys;
mod options;
mod payload;
mod robot;

use std::sync::Arc;

use zenoh::Session;
use zenoh::bytes::Encoding;

pub use join::Joining;
pub use keys::{FrameKey, Keys};
pub use payload::Slices;
pub use robot::{RobotNode, RobotService, ServiceRequest, TopicPublisher, TopicSubscriber};

use crate::config::BusConfig;
use crate::error::{Error, Result};

/// An open session and its keys. Cheap to clone.
#[derive(Clone)]
pub struct Bus {
    session: Session,
    keys: Arc<Keys>,
    config: Arc<BusConfig>,
}

impl Bus {
    /// What is declared and put on.
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// The names of things.
    pub fn keys(&self) -> &Keys {
        &self.keys
    }

    /// Its bounds.
    pub fn config(&self) -> &BusConfig {
        &self.config
    }

    /// What tells this session from all others, in lower-case hexadecimal.
    pub fn id(&self) -> String {
        self.session.zid().to_string()
    }

    /// Ends the session and everything that was declared on it.
    pub async fn close(&self) {
        if let Err(error) = self.session.close().await {
            tracing::warn!("the Zenoh session did not close in order: {error}");
        }
    }
}

/// How a message of `orenx.v1` says what it is.
pub fn encoding_of(message: &str) -> Encoding {
    Encoding::APPLICATION_PROTOBUF.with_schema(format!("orenx.v1.{message}"))
}

/// Refuses a payload that says to be something else. Bytes of no stated kind are taken as they are.
pub fn check_encoding(encoding: &Encoding, message: &str) -> Result<()> {
    let is_ours = *encoding == Encoding::ZENOH_BYTES
        || *encoding == Encoding::APPLICATION_PROTOBUF
        || *encoding == encoding_of(message);
    if is_ours {
        return Ok(());
    }
    let problem = format!("'{encoding}' is not {}", encoding_of(message));
    Err(Error::invalid("encoding", problem))
}

/// A declaration or a publication that the session refused.
pub fn bus_error(what: &str, error: &zenoh::Error) -> Error {
    Error::Unavailable(format!("Zenoh: {what}: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn payloads_of_another_kind_are_refused() {
        let check = |encoding: Encoding| check_encoding(&encoding, "Frame");
        assert_eq!(encoding_of("Frame").to_string(), "application/protobuf;orenx.v1.Frame");
        check(encoding_of("Frame")).expect("ours");
        check(Encoding::ZENOH_BYTES).expect("unsaid");
        check(Encoding::APPLICATION_PROTOBUF).expect("unsaid which");
        for other in [encoding_of("FrameAck"), Encoding::APPLICATION_CDR, Encoding::TEXT_PLAIN] {
            let error = check(other).expect_err("another").to_string();
            assert!(error.starts_with("encoding: ") && error.contains("orenx.v1.Frame"), "{error}");
        }
    }
}
