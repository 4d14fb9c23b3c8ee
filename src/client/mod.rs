//! Clients of a server: gRPC for the demo robot, `orenx stream` and whoever asks; HTTP and Zenoh for
//! those who prefer them.

mod credentials;
mod dialing;
mod http;
mod images;
mod language;
mod mirror;
mod planner;
mod questioner;
mod snapshots;
mod stream;
mod zenoh;

use std::time::Duration;

use glam::Vec3;
use tokio::sync::mpsc;
use tokio_stream::{Stream, StreamExt};
use tonic::Streaming;
use tonic::codegen::http::Uri;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::{Channel, Endpoint};

use crate::engine::Emptied;
use crate::error::{Error, Result};
use crate::geometry::Aabb;
use crate::map::{Clear, Edited, Fields, Stamp};
use crate::service::{
    ClassifyQuestion, ClassifyReply, FindQuestion, FindReply, ImageQuestion, ImageReply, MapReport,
    MapSummary, PointsQuestion, PointsReply,
};
use crate::wire::v1::ingest_client::IngestClient;
use crate::wire::v1::language_client::LanguageClient;
use crate::wire::v1::maps_client::MapsClient;
use crate::wire::v1::query_client::QueryClient;
use crate::wire::v1::render_client::RenderClient;
use crate::wire::{
    FindRequest, MAX_MESSAGE_BYTES, classify_question_to_wire, clear_to_wire, error_from_status,
    find_question_to_wire, image_question_to_wire, image_reply_from_wire, map_list_from_wire,
    map_stats_from_wire, points_question_to_wire, stamp_to_wire, stream_question_to_wire,
    stream_reply_from_wire, v1,
};

pub use self::zenoh::ZenohClient;
pub use credentials::Credentials;
pub use http::HttpClient;
pub use images::camera_json;
pub use mirror::{Mirror, MirrorState};
pub use planner::{RegionNews, TrajectoryNews};
pub use questioner::Questioner;
pub use stream::{Outgoing, Pace, StreamReport, load_ahead, send};

use credentials::{Dial, Showing};
use dialing::Dialing;

/// How long a connection may take to be made.
const CONNECT: Duration = Duration::from_secs(10);

/// A channel whose calls show our key.
type Authorized = InterceptedService<Channel, Showing>;

/// A connection to one server. Cheap to clone; clones share the connection.
#[derive(Clone)]
pub struct Client {
    channel: Authorized,
}

impl Client {
    /// Connects to `host:port`, `grpc://host:port` or, over TLS, `grpcs://host:port`.
    pub async fn connect(url: &str) -> Result<Self> {
        Self::connect_with(url, &Credentials::default()).await
    }

    /// The same, with what a server asks for.
    pub async fn connect_with(url: &str, credentials: &Credentials) -> Result<Self> {
        let wrong = |problem: String| Error::invalid("URL", format!("'{url}': {problem}"));
        let (scheme, rest) = url.split_once("://").unwrap_or(("grpc", url));
        let is_secure = match scheme {
            "http" | "grpc" => false,
            "https" | "grpcs" => true,
            _ => return Err(wrong(format!("{scheme}:// is not spoken; try grpc://host:7610"))),
        };
        // The way there is ours, TLS included: all that the transport must know is the name.
        let uri: Uri = format!("http://{rest}").parse().map_err(|_| wrong("is no URL".into()))?;
        let host = uri.host().ok_or_else(|| wrong("has no host".into()))?;
        let port = uri.port_u16().unwrap_or(if is_secure { 443 } else { 80 });
        let (dial, spoken) = match is_secure {
            true => (Dial::secure(host, port, credentials, b"h2")?, "https"),
            false => (Dial::plain(host, port), "http"),
        };
        let origin = format!("{spoken}://{}", dial.authority());
        let endpoint = Endpoint::from(uri)
            .origin(origin.parse().map_err(|_| wrong("is no URL".into()))?)
            .connect_timeout(CONNECT);
        let channel = endpoint.connect_with_connector(Dialing(dial)).await.map_err(|e| {
            Error::Unavailable(format!("no server answers at {url}: {}", root_cause(&e)))
        })?;
        let channel = InterceptedService::new(channel, Showing(credentials.header()?));
        Ok(Self { channel })
    }

    /// Distance, gradient, occupancy, state and color at points (world metres), of epoch `min_epoch` or a
    /// later one.
    pub async fn query_points(
        &self,
        map_id: &str,
        points: &[Vec3],
        fields: Fields,
        min_epoch: u64,
    ) -> Result<PointsReply> {
        let question = PointsQuestion {
            map_id: map_id.into(),
            fields,
            min_epoch,
            ..PointsQuestion::new(points.to_vec())
        };
        self.ask(&question).await
    }

    /// The answer to any question about points.
    pub async fn ask(&self, question: &PointsQuestion) -> Result<PointsReply> {
        let reply = QueryClient::new(self.channel.clone())
            .max_decoding_message_size(MAX_MESSAGE_BYTES)
            .query_points(points_question_to_wire(question))
            .await
            .map_err(|status| error_from_status(&status))?;
        Ok(reply.into_inner().into())
    }

    /// Sends questions as they come and returns what became of them, in the same order. The server
    /// reads a few ahead of what is read here.
    pub async fn stream_query(
        &self,
        questions: impl Stream<Item = (u64, PointsQuestion)> + Send + 'static,
    ) -> Result<Answers> {
        let messages = questions.map(|(id, question)| stream_question_to_wire(id, &question));
        let answers = QueryClient::new(self.channel.clone())
            .max_decoding_message_size(MAX_MESSAGE_BYTES)
            .stream_query(messages)
            .await
            .map_err(|status| error_from_status(&status))?;
        Ok(Answers(answers.into_inner()))
    }

    /// The images that a question asks for.
    pub async fn render(&self, question: &ImageQuestion) -> Result<ImageReply> {
        let reply = RenderClient::new(self.channel.clone())
            .max_decoding_message_size(MAX_MESSAGE_BYTES)
            .render(image_question_to_wire(question))
            .await
            .map_err(|status| error_from_status(&status))?;
        image_reply_from_wire(reply.into_inner(), &question.images)
    }

    /// The things in a map that fit what is sought.
    pub async fn find(&self, question: &FindQuestion) -> Result<FindReply> {
        let mut client =
            LanguageClient::new(self.channel.clone()).max_decoding_message_size(MAX_MESSAGE_BYTES);
        let reply = match find_question_to_wire(question) {
            FindRequest::Text(message) => client.query_text(message).await,
            FindRequest::Embedding(message) => client.query_embedding(message).await,
        };
        Ok(reply.map_err(|status| error_from_status(&status))?.into_inner().into())
    }

    /// The classes of points.
    pub async fn classify(&self, question: &ClassifyQuestion) -> Result<ClassifyReply> {
        let reply = LanguageClient::new(self.channel.clone())
            .max_decoding_message_size(MAX_MESSAGE_BYTES)
            .classify(classify_question_to_wire(question))
            .await
            .map_err(|status| error_from_status(&status))?;
        Ok(reply.into_inner().into())
    }

    /// Every map of the server.
    pub async fn list_maps(&self) -> Result<Vec<MapSummary>> {
        let reply = MapsClient::new(self.channel.clone())
            .list_maps(v1::ListMapsRequest {})
            .await
            .map_err(|status| error_from_status(&status))?;
        Ok(map_list_from_wire(reply.into_inner()))
    }

    /// The box around everything that a map has observed; empty for an empty map.
    pub async fn bounds(&self, map_id: &str) -> Result<Aabb> {
        let maps = self.list_maps().await?;
        let map = maps.into_iter().find(|map| map.map_id == map_id);
        let missing = || Error::NotFound { what: format!("map '{map_id}'") };
        Ok(map.ok_or_else(missing)?.bounds)
    }

    /// One map's counters.
    pub async fn map_stats(&self, map_id: &str) -> Result<MapReport> {
        let reply = MapsClient::new(self.channel.clone())
            .get_map_stats(v1::GetMapStatsRequest { map_id: map_id.into() })
            .await
            .map_err(|status| error_from_status(&status))?;
        map_stats_from_wire(reply.into_inner())
    }

    /// Makes an empty map; `settings`, by the names of `[map]`, go over those of the server.
    pub async fn create_map(
        &self,
        map_id: &str,
        settings: impl IntoIterator<Item = (String, String)>,
    ) -> Result<()> {
        let settings = settings.into_iter().collect();
        MapsClient::new(self.channel.clone())
            .create_map(v1::CreateMapRequest { map_id: map_id.into(), settings })
            .await
            .map_err(|status| error_from_status(&status))?;
        Ok(())
    }

    /// Deletes a map and all that is stored of it.
    pub async fn delete_map(&self, map_id: &str) -> Result<()> {
        MapsClient::new(self.channel.clone())
            .delete_map(v1::DeleteMapRequest { map_id: map_id.into() })
            .await
            .map_err(|status| error_from_status(&status))?;
        Ok(())
    }

    /// Empties a map; the first epoch of the empty one and how many waiting frames were dropped.
    pub async fn reset_map(&self, map_id: &str) -> Result<Emptied> {
        let reply = MapsClient::new(self.channel.clone())
            .reset_map(v1::ResetMapRequest { map_id: map_id.into() })
            .await
            .map_err(|status| error_from_status(&status))?
            .into_inner();
        Ok(Emptied { epoch: reply.epoch, frames_dropped: reply.frames_dropped })
    }

    /// Forgets what was seen.
    pub async fn clear_region(&self, map_id: &str, clear: &Clear) -> Result<Edited> {
        let reply = MapsClient::new(self.channel.clone())
            .clear_region(clear_to_wire(map_id, clear))
            .await
            .map_err(|status| error_from_status(&status))?;
        Ok(reply.into_inner().into())
    }

    /// Puts known geometry into a map.
    pub async fn stamp_geometry(&self, map_id: &str, stamp: &Stamp) -> Result<Edited> {
        let reply = MapsClient::new(self.channel.clone())
            .max_encoding_message_size(MAX_MESSAGE_BYTES)
            .stamp_geometry(stamp_to_wire(map_id, stamp))
            .await
            .map_err(|status| error_from_status(&status))?;
        Ok(reply.into_inner().into())
    }
}

/// Who frames can be sent to.
pub trait TakesFrames {
    /// Sends frames as they come and returns their acks. Whoever calls bounds the frames that are
    /// under way, by the acks.
    fn stream_frames(
        &self,
        frames: impl Stream<Item = v1::Frame> + Send + 'static,
    ) -> impl Future<Output = Result<Acks>> + Send;
}

impl TakesFrames for Client {
    async fn stream_frames(
        &self,
        frames: impl Stream<Item = v1::Frame> + Send + 'static,
    ) -> Result<Acks> {
        let acks = IngestClient::new(self.channel.clone())
            .max_encoding_message_size(MAX_MESSAGE_BYTES)
            .stream_frames(frames)
            .await
            .map_err(|status| error_from_status(&status))?;
        Ok(Acks(AckSource::Grpc(Box::new(acks.into_inner()))))
    }
}

/// The acks of one stream of frames.
pub struct Acks(AckSource);

enum AckSource {
    Grpc(Box<Streaming<v1::FrameAck>>),
    Bus(mpsc::Receiver<Result<v1::FrameAck>>),
}

impl Acks {
    /// The next ack; `None` after the last.
    pub async fn next(&mut self) -> Result<Option<v1::FrameAck>> {
        match &mut self.0 {
            AckSource::Grpc(acks) => acks.message().await.map_err(|s| error_from_status(&s)),
            AckSource::Bus(acks) => acks.recv().await.transpose(),
        }
    }

    fn of_bus(acks: mpsc::Receiver<Result<v1::FrameAck>>) -> Self {
        Self(AckSource::Bus(acks))
    }
}

/// The answers of one stream of questions.
pub struct Answers(Streaming<v1::StreamQueryReply>);

impl Answers {
    /// The number of the next question, and its answer or refusal; `None` after the last.
    pub async fn next(&mut self) -> Result<Option<(u64, Result<PointsReply>)>> {
        let message = self.0.message().await.map_err(|status| error_from_status(&status))?;
        message.map(stream_reply_from_wire).transpose()
    }
}

/// What the operating system said, under the layers that say "transport error".
fn root_cause(error: &dyn std::error::Error) -> String {
    let mut cause = error;
    while let Some(deeper) = cause.source() {
        cause = deeper;
    }
    cause.to_string()
}
