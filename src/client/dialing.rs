//! How a channel of gRPC is made where the way to the server is ours.

use std::pin::Pin;
use std::task::{Context, Poll};

use hyper_util::rt::TokioIo;
use tonic::codegen::http::Uri;
use tower_service::Service;

use super::credentials::{Bytes, Dial, NoConnection};

/// Connects to one server, whatever it is asked for.
#[derive(Clone)]
pub(super) struct Dialing(pub(super) Dial);

impl Service<Uri> for Dialing {
    type Response = TokioIo<Box<dyn Bytes>>;
    type Error = std::io::Error;
    type Future = Pin<Box<dyn Future<Output = std::io::Result<Self::Response>> + Send>>;

    fn poll_ready(&mut self, _context: &mut Context<'_>) -> Poll<std::io::Result<()>> {
        Poll::Ready(Ok(()))
    }

    fn call(&mut self, _uri: Uri) -> Self::Future {
        let dial = self.0.clone();
        Box::pin(async move {
            dial.connect().await.map(TokioIo::new).map_err(|error| match error {
                NoConnection::Failed(problem) => std::io::Error::other(problem),
                NoConnection::OtherProtocol => std::io::Error::other("speaks no gRPC there"),
            })
        })
    }
}
