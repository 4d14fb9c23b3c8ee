//! Questions to a server, whatever it speaks.

use super::{Client, Credentials, HttpClient, ZenohClient};
use crate::error::Result;
use crate::geometry::Aabb;
use crate::service::{
    ClassifyQuestion, ClassifyReply, FindQuestion, FindReply, ImageQuestion, ImageReply,
    PointsQuestion, PointsReply,
};

/// A client of any transport.
#[derive(Clone)]
pub enum Questioner {
    Grpc(Client),
    Http(HttpClient),
    Zenoh(ZenohClient),
}

impl Questioner {
    /// Connects to `grpc://host:port`, or to `http://host:port` in HTTP if that is what answers
    /// there, else in gRPC, or to `zenoh+tcp://host:port`. `grpcs://` and `https://` are the same over
    /// TLS.
    pub async fn connect(url: &str) -> Result<Self> {
        Self::connect_with(url, &Credentials::default()).await
    }

    /// The same, with what a server asks for. Over Zenoh that is Zenoh's own matter.
    pub async fn connect_with(url: &str, credentials: &Credentials) -> Result<Self> {
        if url.starts_with("zenoh+") {
            return ZenohClient::connect(url).await.map(Self::Zenoh);
        }
        if url.starts_with("http://") || url.starts_with("https://") {
            let http = HttpClient::with(url, credentials)?;
            if http.is_spoken().await? {
                return Ok(Self::Http(http));
            }
        }
        Client::connect_with(url, credentials).await.map(Self::Grpc)
    }

    /// The answer to a question about points.
    pub async fn ask(&self, question: &PointsQuestion) -> Result<PointsReply> {
        match self {
            Self::Grpc(client) => client.ask(question).await,
            Self::Http(client) => client.ask(question).await,
            Self::Zenoh(client) => client.ask(question).await,
        }
    }

    /// The images that a question asks for.
    pub async fn render(&self, question: &ImageQuestion) -> Result<ImageReply> {
        match self {
            Self::Grpc(client) => client.render(question).await,
            Self::Http(client) => client.render(question).await,
            Self::Zenoh(client) => client.render(question).await,
        }
    }

    /// The things in a map that fit what is sought.
    pub async fn find(&self, question: &FindQuestion) -> Result<FindReply> {
        match self {
            Self::Grpc(client) => client.find(question).await,
            Self::Http(client) => client.find(question).await,
            Self::Zenoh(client) => client.find(question).await,
        }
    }

    /// The classes of points.
    pub async fn classify(&self, question: &ClassifyQuestion) -> Result<ClassifyReply> {
        match self {
            Self::Grpc(client) => client.classify(question).await,
            Self::Http(client) => client.classify(question).await,
            Self::Zenoh(client) => client.classify(question).await,
        }
    }

    /// The box around everything that a map has observed; empty for an empty map.
    pub async fn bounds(&self, map_id: &str) -> Result<Aabb> {
        match self {
            Self::Grpc(client) => client.bounds(map_id).await,
            Self::Http(client) => client.bounds(map_id).await,
            Self::Zenoh(client) => client.bounds(map_id).await,
        }
    }
}
