//! The port: connections in, each within its limits, and the way down.

use std::net::SocketAddr;
use std::pin::{Pin, pin};
use std::sync::Arc;

use axum::Router;
use hyper::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpListener;
use tokio::sync::{Semaphore, watch};
use tokio::task::{JoinHandle, JoinSet};

use tower_service::Service as _;

use super::super::access::Transport;
use super::super::calls::Calls;
use super::super::connection::Connection;
use super::super::entrance::{ACCEPT_PAUSE, Entrance, accept_one};
use super::super::zenoh::Tally;
use super::limits::Limits;
use super::stall::Stall;
use super::{Edge, router};
use crate::config::ServerConfig;
use crate::service::Service;

/// Headers of a request, in number.
const MAX_HEADERS: usize = 100;
/// Read at a time. Headers that do not fit are refused before a handler sees them.
const BUFFER_BYTES: usize = 256 << 10;

/// An open HTTP port. It answers from the start, with 503 until it is given a service.
pub struct Door {
    address: SocketAddr,
    pub(super) edge: Arc<Edge>,
    close: watch::Sender<bool>,
    task: JoinHandle<()>,
}

impl Door {
    /// Starts to answer on `listener`, within a runtime. The settings bound bodies and say whose pages
    /// may ask.
    pub(in crate::serve) fn open(
        listener: TcpListener,
        config: &ServerConfig,
        entrance: Arc<Entrance>,
    ) -> std::io::Result<Self> {
        let limits = Limits::new(config.max_points, config.max_pixels);
        Self::within(listener, Edge::new(limits, entrance, config.written.clone()))
    }

    pub(super) fn within(listener: TcpListener, edge: Edge) -> std::io::Result<Self> {
        let address = listener.local_addr()?;
        let edge = Arc::new(edge);
        let (close, closing) = watch::channel(false);
        let task = tokio::spawn(accept(listener, edge.clone(), closing));
        Ok(Self { address, edge, close, task })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The map is loaded: questions are answered from now on. `calls` are those over gRPC, `zenoh` what
    /// came there.
    pub(in crate::serve) fn serve(
        &self,
        service: Arc<Service>,
        calls: Arc<Calls>,
        zenoh: Option<Arc<Tally>>,
    ) {
        self.edge.serve(service, calls, zenoh);
    }

    /// Says that it is not ready any more, and why, and goes on answering.
    pub(in crate::serve) fn stop(&self, reason: String) {
        self.edge.stop(reason);
    }

    /// Accepts no more, and waits until the requests under way have their answers.
    pub(in crate::serve) async fn close(mut self) {
        self.close.send_replace(true);
        if let Err(error) = (&mut self.task).await {
            tracing::error!(%error, "the HTTP task failed");
        }
    }
}

impl Drop for Door {
    fn drop(&mut self) {
        self.task.abort();
    }
}

/// Accepts connections until `closing`, then ends them. Dropping it drops them.
async fn accept(listener: TcpListener, edge: Arc<Edge>, mut closing: watch::Receiver<bool>) {
    let (limits, entrance) = (edge.limits.clone(), edge.entrance.clone());
    let router = router(edge);
    let places = Arc::new(Semaphore::new(limits.connections));
    let mut connections = JoinSet::new();
    loop {
        while connections.try_join_next().is_some() {}
        let accepted = tokio::select! {
            accepted = accept_one(&listener, &places) => accepted,
            _ = closing.wait_for(|closing| *closing) => break,
        };
        match accepted {
            Ok((stream, place)) => {
                let (router, limits, closing) = (router.clone(), limits.clone(), closing.clone());
                let entrance = entrance.clone();
                connections.spawn(async move {
                    let entered = entrance.enter(Transport::Http, stream, place).await;
                    if let Some(connection) = entered {
                        serve(connection, router, limits, closing).await;
                    }
                });
            }
            Err(error) => {
                tracing::warn!(%error, "an HTTP connection was not accepted");
                tokio::time::sleep(ACCEPT_PAUSE).await;
            }
        }
    }
    drop(listener);
    let ended = async { while connections.join_next().await.is_some() {} };
    if tokio::time::timeout(limits.drain_time, ended).await.is_err() {
        tracing::warn!("some HTTP connections did not end within {:?}", limits.drain_time);
    }
}

/// One connection: requests in turn until either side ends it.
async fn serve(
    stream: Connection,
    router: Router,
    limits: Limits,
    mut closing: watch::Receiver<bool>,
) {
    let peer = stream.peer();
    let answer = service_fn(move |mut request: Request<Incoming>| {
        request.extensions_mut().insert(peer);
        router.clone().call(request)
    });
    let io = TokioIo::new(Stall::new(stream, limits.write_time));
    let mut connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(limits.header_time)
        .max_headers(MAX_HEADERS)
        .max_buf_size(BUFFER_BYTES)
        .serve_connection(io, answer);
    let ended = {
        let mut closing = pin!(closing.wait_for(|closing| *closing));
        let mut told = false;
        std::future::poll_fn(|context| {
            if !told && closing.as_mut().poll(context).is_ready() {
                told = true;
                Pin::new(&mut connection).graceful_shutdown();
            }
            connection.poll_without_shutdown(context)
        })
        .await
    };
    if let Err(error) = ended {
        tracing::debug!(%error, "an HTTP connection failed");
    }
    linger(connection.into_parts().io.into_inner().into_inner(), &limits).await;
}

/// Closes our side and reads what the other still sends. A socket that is closed with unread bytes
/// resets the connection, and a client that is busy sending would never see why it was refused.
async fn linger(mut stream: Connection, limits: &Limits) {
    let rest = async {
        stream.shutdown().await?;
        let mut rest = stream.take(limits.linger_bytes as u64);
        tokio::io::copy(&mut rest, &mut tokio::io::sink()).await
    };
    // Whoever has not ended by then is cut off.
    let _ = tokio::time::timeout(limits.linger_time, rest).await;
}
