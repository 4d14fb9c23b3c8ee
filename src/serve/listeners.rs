//! The ports of a server.

use std::net::SocketAddr;

use tokio::net::TcpListener;

use super::http::Door;
use crate::bus::Joining;
use crate::config::{Ros2Config, ServerConfig};
use crate::error::{Error, Result};

/// The ports, open. gRPC waits for [`super::run()`]; HTTP answers probes from the start, and everything
/// else with 503 until then.
pub struct Listeners {
    pub(super) grpc: TcpListener,
    pub(super) http: Option<Door>,
    /// Zenoh, on its way.
    pub(super) bus: Option<Joining>,
    /// What of ROS 2 there is on it.
    pub(super) ros2: Option<Ros2Config>,
}

impl Listeners {
    /// Opens the ports of the settings, within a runtime.
    pub async fn bind(config: &ServerConfig) -> Result<Self> {
        let grpc = listen("server.grpc", config.grpc).await?;
        let http = match config.http {
            Some(address) => Some(door(address, config).await?),
            None => None,
        };
        let bus = match &config.bus {
            Some(bus) => Some(Joining::begin(bus).await?),
            None => None,
        };
        Ok(Self { grpc, http, bus, ros2: config.ros2.clone() })
    }

    /// Where gRPC listens.
    pub fn grpc_address(&self) -> Result<SocketAddr> {
        self.grpc.local_addr().map_err(|e| Error::Internal(format!("the gRPC port: {e}")))
    }

    /// Where HTTP listens, if it does.
    pub fn http_address(&self) -> Option<SocketAddr> {
        self.http.as_ref().map(Door::address)
    }
}

/// gRPC alone.
impl From<TcpListener> for Listeners {
    fn from(grpc: TcpListener) -> Self {
        Self { grpc, http: None, bus: None, ros2: None }
    }
}

async fn door(address: SocketAddr, config: &ServerConfig) -> Result<Door> {
    let listener = listen("server.http", address).await?;
    Door::open(listener, config.max_points, config.max_pixels)
        .map_err(|e| refused("server.http", address, &e))
}

async fn listen(key: &str, address: SocketAddr) -> Result<TcpListener> {
    TcpListener::bind(address).await.map_err(|e| refused(key, address, &e))
}

fn refused(key: &str, address: SocketAddr, error: &std::io::Error) -> Error {
    Error::Unavailable(format!("{key}: cannot listen on {address}: {error}"))
}
