//! A connection of either port, with TLS or without.

use std::io::{Error, ErrorKind, IoSlice, Result};
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio::sync::OwnedSemaphorePermit;
use tokio::time::{Sleep, sleep};
use tokio_rustls::server::TlsStream;
use tonic::transport::server::Connected;

use super::access::{Gate, Transport, Why};

/// Where a connection comes from; attached to each of its requests.
#[derive(Debug, Clone, Copy)]
pub(super) struct Peer(pub(super) SocketAddr);

/// Bytes that come in and go out.
pub(super) struct Connection {
    io: Io,
    peer: Peer,
    opening: Option<Opening>,
    _place: OwnedSemaphorePermit,
}

pub(super) enum Io {
    Plain(TcpStream),
    Tls(Box<TlsStream<TcpStream>>),
}

/// The time within which a client must have said so many bytes, so that one that says nothing, or a byte
/// a minute, does not keep its place for ever.
struct Opening {
    patience: Pin<Box<Sleep>>,
    missing: usize,
    gate: Arc<Gate>,
}

impl Connection {
    pub(super) fn new(io: Io, peer: SocketAddr, place: OwnedSemaphorePermit) -> Self {
        Self { io, peer: Peer(peer), opening: None, _place: place }
    }

    /// Ends it if fewer than `bytes` come within `patience`. For gRPC: HTTP has limits of its own.
    pub(super) fn opens_within(
        mut self,
        patience: Duration,
        bytes: usize,
        gate: Arc<Gate>,
    ) -> Self {
        self.opening = Some(Opening { patience: Box::pin(sleep(patience)), missing: bytes, gate });
        self
    }

    pub(super) fn peer(&self) -> Peer {
        self.peer
    }

    /// Whether it may be silent for as long as it likes.
    #[cfg(test)]
    pub(super) fn is_open_ended(&self) -> bool {
        self.opening.is_none()
    }

    #[cfg(test)]
    pub(super) fn tcp(&self) -> &TcpStream {
        match &self.io {
            Io::Plain(stream) => stream,
            Io::Tls(stream) => stream.get_ref().0,
        }
    }
}

impl Connected for Connection {
    type ConnectInfo = Peer;

    fn connect_info(&self) -> Peer {
        self.peer
    }
}

impl AsyncRead for Connection {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<Result<()>> {
        let before = buffer.filled().len();
        let read = match &mut self.io {
            Io::Plain(io) => Pin::new(io).poll_read(context, buffer),
            Io::Tls(io) => Pin::new(io).poll_read(context, buffer),
        };
        let Some(opening) = &mut self.opening else { return read };
        if let Poll::Ready(read) = read {
            opening.missing = opening.missing.saturating_sub(buffer.filled().len() - before);
            if opening.missing == 0 {
                self.opening = None;
            }
            return Poll::Ready(read);
        }
        ready!(opening.patience.as_mut().poll(context));
        opening.gate.refusals.count(Transport::Grpc, Why::Silent);
        self.opening = None;
        Poll::Ready(Err(Error::new(ErrorKind::TimedOut, "the client did not begin in time")))
    }
}

impl AsyncWrite for Connection {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<Result<usize>> {
        match &mut self.io {
            Io::Plain(io) => Pin::new(io).poll_write(context, bytes),
            Io::Tls(io) => Pin::new(io).poll_write(context, bytes),
        }
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[IoSlice<'_>],
    ) -> Poll<Result<usize>> {
        match &mut self.io {
            Io::Plain(io) => Pin::new(io).poll_write_vectored(context, slices),
            Io::Tls(io) => Pin::new(io).poll_write_vectored(context, slices),
        }
    }

    fn is_write_vectored(&self) -> bool {
        match &self.io {
            Io::Plain(io) => io.is_write_vectored(),
            Io::Tls(io) => io.is_write_vectored(),
        }
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Result<()>> {
        match &mut self.io {
            Io::Plain(io) => Pin::new(io).poll_flush(context),
            Io::Tls(io) => Pin::new(io).poll_flush(context),
        }
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Result<()>> {
        match &mut self.io {
            Io::Plain(io) => Pin::new(io).poll_shutdown(context),
            Io::Tls(io) => Pin::new(io).poll_shutdown(context),
        }
    }
}
