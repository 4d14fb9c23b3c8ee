//! The ports of a server.

use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;

use tokio::net::TcpListener;

use super::entrance::Entrance;
use super::http::Door;
use crate::bus::Joining;
use crate::config::{Ros2Config, ServerConfig, Settings, is_loopback};
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
    /// What operators may see.
    pub(super) written: Arc<Settings>,
    /// What every connection of gRPC and HTTP passes.
    pub(super) entrance: Arc<Entrance>,
}

impl Listeners {
    /// Opens the ports of the settings, within a runtime.
    pub async fn bind(config: &ServerConfig) -> Result<Self> {
        let entrance = Arc::new(Entrance::new(&config.access)?);
        warn_of_open_ports(config);
        let grpc = listen("server.grpc", config.grpc).await?;
        let http = match config.http {
            Some(address) => Some(door(address, config, entrance.clone()).await?),
            None => None,
        };
        let bus = match &config.bus {
            Some(bus) => Some(Joining::begin(bus).await?),
            None => None,
        };
        Ok(Self {
            grpc,
            http,
            bus,
            ros2: config.ros2.clone(),
            written: config.written.clone(),
            entrance,
        })
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
        let (written, entrance) = (Arc::default(), Arc::new(Entrance::open()));
        Self { grpc, http: None, bus: None, ros2: None, written, entrance }
    }
}

async fn door(address: SocketAddr, config: &ServerConfig, entrance: Arc<Entrance>) -> Result<Door> {
    let listener = listen("server.http", address).await?;
    Door::open(listener, config, entrance).map_err(|e| refused("server.http", address, &e))
}

/// Says what is reachable from the network and not guarded as it could be.
fn warn_of_open_ports(config: &ServerConfig) {
    let ports = [Some(("server.grpc", config.grpc)), config.http.map(|at| ("server.http", at))];
    for (key, address) in ports.into_iter().flatten().filter(|(_, at)| !is_loopback(*at)) {
        if !config.access.is_guarded() {
            tracing::warn!("{key}: whoever reaches {address} may read and empty every map");
        } else if config.access.tls.is_none() {
            tracing::warn!(
                "{key}: without TLS, keys and maps cross the network to {address} in the clear"
            );
        }
    }
    let bus = config.bus.as_ref().filter(|bus| bus.file.is_none());
    for endpoint in bus.iter().flat_map(|bus| &bus.listen).filter(|at| !is_local_endpoint(at)) {
        tracing::warn!(
            "zenoh.listen: whoever reaches {endpoint} may read and write every map; users and access \
             control are Zenoh's own, in the file of zenoh.config"
        );
    }
}

/// Whether only this machine reaches what Zenoh listens on, as in `tcp/127.0.0.1:7447`.
fn is_local_endpoint(endpoint: &str) -> bool {
    let (protocol, rest) = endpoint.split_once('/').unwrap_or(("", endpoint));
    let address = rest.split(['?', '#']).next().unwrap_or_default();
    let host = address.rsplit_once(':').map_or(address, |(host, _)| host);
    protocol.starts_with("unix")
        || host == "localhost"
        || host.trim_matches(['[', ']']).parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

async fn listen(key: &str, address: SocketAddr) -> Result<TcpListener> {
    TcpListener::bind(address).await.map_err(|e| refused(key, address, &e))
}

fn refused(key: &str, address: SocketAddr, error: &std::io::Error) -> Error {
    Error::Unavailable(format!("{key}: cannot listen on {address}: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn endpoints_of_this_machine_are_told_from_others() {
        for here in ["tcp/127.0.0.1:7447", "tls/localhost:0", "tcp/[::1]:7447", "unixsock-stream/a"]
        {
            assert!(is_local_endpoint(here), "{here}");
        }
        for open in ["tcp/0.0.0.0:7447", "tcp/[::]:7447#iface=eth0", "udp/192.168.0.2:7447", "x"] {
            assert!(!is_local_endpoint(open), "{open}");
        }
    }
}
