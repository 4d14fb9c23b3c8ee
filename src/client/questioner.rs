//! Questions to a server, whatever it speaks.

use super::{Client, HttpClient};
use crate::error::Result;
use crate::service::{PointsQuestion, PointsReply};

/// A client of either transport.
#[derive(Clone)]
pub enum Questioner {
    Grpc(Client),
    Http(HttpClient),
}

impl Questioner {
    /// Connects to `grpc://host:port`, or to `http://host:port` in HTTP if that is what answers
    /// there, else in gRPC.
    pub async fn connect(url: &str) -> Result<Self> {
        if url.starts_with("http://") {
            let http = HttpClient::new(url)?;
            if http.is_spoken().await? {
                return Ok(Self::Http(http));
            }
        }
        Client::connect(url).await.map(Self::Grpc)
    }

    /// The answer to a question about points.
    pub async fn ask(&self, question: &PointsQuestion) -> Result<PointsReply> {
        match self {
            Self::Grpc(client) => client.ask(question).await,
            Self::Http(client) => client.ask(question).await,
        }
    }
}
