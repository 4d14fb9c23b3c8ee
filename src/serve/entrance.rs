//! How connections come in, on either port: a place each, TLS where it is spoken, and the gate that each
//! of their requests passes.

use std::sync::Arc;
use std::time::Duration;

use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};

use super::access::{Gate, Transport, Why};
use super::connection::{Connection, Io};
use super::tls::Tls;
use crate::config::{AccessConfig, ServerConfig};
use crate::error::Result;

/// A pause when the system has no more sockets: they come back as connections end.
pub(super) const ACCEPT_PAUSE: Duration = Duration::from_millis(50);
/// How long it may take until a connection is one of TLS.
const HANDSHAKE: Duration = Duration::from_secs(10);
/// How often files of keys and certificates are looked at.
const LOOK_AGAIN: Duration = Duration::from_secs(10);

/// The same for both ports.
pub(super) struct Entrance {
    pub(super) gate: Arc<Gate>,
    tls: Option<Tls>,
}

impl Entrance {
    /// Reads keys and certificates.
    pub(super) fn new(access: &AccessConfig) -> Result<Self> {
        let tls = access.tls.as_ref().map(Tls::new).transpose()?;
        Ok(Self { gate: Arc::new(Gate::new(access)?), tls })
    }

    /// Open to everyone.
    pub(super) fn open() -> Self {
        Self { gate: Arc::new(Gate::open()), tls: None }
    }

    /// Makes a connection of a socket. `None`: it did not become one of TLS, which is counted.
    pub(super) async fn enter(
        &self,
        transport: Transport,
        stream: TcpStream,
        place: OwnedSemaphorePermit,
    ) -> Option<Connection> {
        let peer = stream.peer_addr().ok()?;
        let Some(tls) = &self.tls else {
            return Some(Connection::new(Io::Plain(stream), peer, place));
        };
        let accepting = tls.acceptor(transport).accept(stream);
        let problem = match tokio::time::timeout(HANDSHAKE, accepting).await {
            Ok(Ok(stream)) => return Some(Connection::new(Io::Tls(Box::new(stream)), peer, place)),
            Ok(Err(error)) => error.to_string(),
            Err(_) => format!("no end of it within {HANDSHAKE:?}"),
        };
        self.gate.refusals.count(transport, Why::Tls);
        tracing::info!(%peer, transport = transport.name(), "no TLS with a client: {problem}");
        None
    }

    /// Reads the files again; whether something changed.
    fn renew(&self) -> Result<bool> {
        let keys = self.gate.renew()?;
        let certificates = self.tls.as_ref().map_or(Ok(false), Tls::renew)?;
        Ok(keys || certificates)
    }
}

/// The next connection, once there is a place for it.
pub(super) async fn accept_one(
    listener: &TcpListener,
    places: &Arc<Semaphore>,
) -> std::io::Result<(TcpStream, OwnedSemaphorePermit)> {
    let place = places.clone().acquire_owned().await.map_err(std::io::Error::other)?;
    let (stream, _) = listener.accept().await?;
    // Small messages go out at once: without it an answer waits 40 ms for the acknowledgement of the last.
    stream.set_nodelay(true)?;
    Ok((stream, place))
}

/// Whether the files of the settings can be read and fit together.
pub fn check_files(config: &ServerConfig) -> Result<()> {
    Entrance::new(&config.access).map(drop)
}

/// Keeps keys and certificates as their files are, which are looked at from time to time and on SIGHUP,
/// until `closing`. What is wrong is told, and what was read before stays.
pub(super) async fn keep_fresh(entrance: Arc<Entrance>, mut closing: watch::Receiver<bool>) {
    let mut clock = tokio::time::interval(LOOK_AGAIN);
    clock.tick().await; // the first one is at once
    let mut called = Hangup::new();
    let mut told = String::new();
    loop {
        let is_called = tokio::select! {
            () = called.next() => true,
            _ = clock.tick() => false,
            _ = closing.wait_for(|closing| *closing) => return,
        };
        let read = entrance.clone();
        let outcome = match tokio::task::spawn_blocking(move || read.renew()).await {
            Ok(outcome) => outcome,
            Err(error) => {
                tracing::error!(%error, "reading keys and certificates failed");
                continue;
            }
        };
        let problem = outcome.as_ref().err().map(ToString::to_string).unwrap_or_default();
        match outcome {
            Ok(true) => tracing::warn!("keys and certificates were read anew"),
            Ok(false) if is_called => tracing::warn!("keys and certificates are as they were"),
            Ok(false) => {}
            // Not every ten seconds.
            Err(_) if !is_called && problem == told => {}
            Err(_) => {
                tracing::error!("keys and certificates stay as they were read before: {problem}")
            }
        }
        told = problem;
    }
}

/// SIGHUP, where there is such a thing.
struct Hangup {
    #[cfg(unix)]
    signal: Option<tokio::signal::unix::Signal>,
}

impl Hangup {
    fn new() -> Self {
        #[cfg(unix)]
        {
            use tokio::signal::unix::{SignalKind, signal};
            Self { signal: signal(SignalKind::hangup()).ok() }
        }
        #[cfg(not(unix))]
        Self {}
    }

    async fn next(&mut self) {
        #[cfg(unix)]
        if let Some(signal) = &mut self.signal
            && signal.recv().await.is_some()
        {
            return;
        }
        std::future::pending().await
    }
}
