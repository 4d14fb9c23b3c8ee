//! The connections of gRPC, as its server takes them.

use std::io::Result;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use tokio::net::TcpListener;
use tokio::sync::Semaphore;
use tokio::task::JoinSet;
use tokio_stream::Stream;

use super::access::Transport;
use super::connection::Connection;
use super::entrance::{ACCEPT_PAUSE, Entrance, accept_one};

/// Connections at a time; the next one waits to be accepted.
const CONNECTIONS: usize = 1024;
/// How HTTP/2 begins, with the head of the first frame: bytes, and the time within which they must come.
/// After them the server asks for signs of life by itself.
const PREFACE_BYTES: usize = 24 + 9;
const PREFACE: Duration = Duration::from_secs(10);

/// A stream of connections, each ready to be spoken over. It owns the port: dropping it closes it.
pub(super) struct Incoming(Next);

type Next = Pin<Box<dyn Future<Output = (Port, Connection)> + Send>>;

impl Incoming {
    pub(super) fn new(listener: TcpListener, entrance: Arc<Entrance>) -> Self {
        Self::within(listener, entrance, PREFACE)
    }

    fn within(listener: TcpListener, entrance: Arc<Entrance>, patience: Duration) -> Self {
        let places = Arc::new(Semaphore::new(CONNECTIONS));
        let port = Port { listener, entrance, places, patience, entering: JoinSet::new() };
        Self(Box::pin(port.next()))
    }
}

impl Stream for Incoming {
    type Item = Result<Connection>;

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        let (port, connection) = ready!(self.0.as_mut().poll(context));
        self.0 = Box::pin(port.next());
        Poll::Ready(Some(Ok(connection)))
    }
}

struct Port {
    listener: TcpListener,
    entrance: Arc<Entrance>,
    places: Arc<Semaphore>,
    patience: Duration,
    /// Those that become connections of TLS: one that is slow holds up nobody.
    entering: JoinSet<Option<Connection>>,
}

impl Port {
    async fn next(mut self) -> (Self, Connection) {
        loop {
            let accepted = tokio::select! {
                accepted = accept_one(&self.listener, &self.places) => accepted,
                Some(entered) = self.entering.join_next() => match entered {
                    Ok(Some(connection)) => {
                        let gate = self.entrance.gate.clone();
                        let opened = connection.opens_within(self.patience, PREFACE_BYTES, gate);
                        return (self, opened);
                    }
                    Ok(None) => continue,
                    Err(error) => {
                        tracing::error!(%error, "accepting a connection failed");
                        continue;
                    }
                },
            };
            match accepted {
                Ok((stream, place)) => {
                    let entrance = self.entrance.clone();
                    let entering =
                        async move { entrance.enter(Transport::Grpc, stream, place).await };
                    self.entering.spawn(entering);
                }
                Err(error) => {
                    tracing::warn!(%error, "a gRPC connection was not accepted");
                    tokio::time::sleep(ACCEPT_PAUSE).await;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    use tokio::net::TcpStream;
    use tokio_stream::StreamExt;

    use super::*;

    async fn connected(patience: Duration) -> (TcpStream, Connection, Arc<Entrance>) {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let address = listener.local_addr().expect("an address");
        let entrance = Arc::new(Entrance::open());
        let mut incoming = Incoming::within(listener, entrance.clone(), patience);
        let client = TcpStream::connect(address).await.expect("a connection");
        let accepted = incoming.next().await.expect("one").expect("a good one");
        (client, accepted, entrance)
    }

    #[tokio::test]
    async fn small_answers_are_not_held_back() {
        let (_client, accepted, _) = connected(PREFACE).await;
        assert!(accepted.tcp().nodelay().expect("an option of the socket"));
    }

    #[tokio::test]
    async fn who_does_not_begin_in_time_loses_the_place() {
        let (mut client, mut accepted, entrance) = connected(Duration::from_millis(5)).await;
        client.write_all(b"PRI * HTTP/2.0").await.expect("sent");
        let mut read = [0; 64];
        accepted.read_exact(&mut read).await.expect_err("it does not go on");
        let silent = entrance.gate.refusals.read().find(|(_, why, _)| *why == "silent");
        assert_eq!(silent, Some(("grpc", "silent", 1)));

        let (mut client, mut accepted, _) = connected(Duration::from_millis(5)).await;
        client.write_all(&[0; PREFACE_BYTES]).await.expect("sent");
        accepted.read_exact(&mut read[..PREFACE_BYTES]).await.expect("in time");
        assert!(accepted.is_open_ended(), "from now on it may be silent");
    }
}
