//! A client over Zenoh: the same messages as over gRPC, put and asked by key.

mod address;
mod frames;

use std::time::Duration;

use prost::Message;
use tokio_stream::Stream;
use zenoh::bytes::Encoding;
use zenoh::qos::Priority;
use zenoh::query::{QueryTarget, Reply};

use super::{Acks, TakesFrames};
use crate::bus::{Bus, Joining, Slices, bus_error, encoding_of};
use crate::error::{Error, Result};
use crate::geometry::Aabb;
use crate::service::{
    ClassifyQuestion, ClassifyReply, FindQuestion, FindReply, ImageQuestion, ImageReply, MapReport,
    PointsQuestion, PointsReply,
};
use crate::wire::{
    FindRequest, classify_question_to_wire, find_question_to_wire, image_question_to_wire,
    image_reply_from_wire, map_stats_from_wire, points_question_to_wire, read_message,
    refusal_from_wire, v1,
};
use address::read_address;

/// How long an answer may take.
const ANSWER: Duration = Duration::from_secs(90);

/// One connection to a Zenoh network. Cheap to clone; clones share the connection.
#[derive(Clone)]
pub struct ZenohClient {
    bus: Bus,
}

impl ZenohClient {
    /// Connects to the router or peer at `zenoh+tcp://host:port[/prefix]`, or with the configuration
    /// `zenoh+file:PATH[#prefix]`.
    pub async fn connect(url: &str) -> Result<Self> {
        let joining = Joining::begin(&read_address(url)?).await?;
        let away = |e| Error::Unavailable(format!("no server answers at {url}: {e}"));
        Ok(Self { bus: joining.joined_now().await.map_err(away)? })
    }

    /// The session and its keys.
    pub fn bus(&self) -> &Bus {
        &self.bus
    }

    /// The answer to a question about points.
    pub async fn ask(&self, question: &PointsQuestion) -> Result<PointsReply> {
        let message = points_question_to_wire(question);
        let reply: v1::QueryPointsReply =
            self.question(&question.map_id, "points", "QueryPointsRequest", &message).await?;
        Ok(reply.into())
    }

    /// The images that a question asks for.
    pub async fn render(&self, question: &ImageQuestion) -> Result<ImageReply> {
        let message = image_question_to_wire(question);
        let reply = self.question(&question.map_id, "render", "RenderRequest", &message).await?;
        image_reply_from_wire(reply, &question.images)
    }

    /// The things in a map that fit what is sought.
    pub async fn find(&self, question: &FindQuestion) -> Result<FindReply> {
        let map_id = &question.map_id;
        let reply: v1::QueryTextReply = match find_question_to_wire(question) {
            FindRequest::Text(message) => {
                self.question(map_id, "text", "QueryTextRequest", &message).await?
            }
            FindRequest::Embedding(message) => {
                self.question(map_id, "embedding", "QueryEmbeddingRequest", &message).await?
            }
        };
        Ok(reply.into())
    }

    /// The classes of points.
    pub async fn classify(&self, question: &ClassifyQuestion) -> Result<ClassifyReply> {
        let message = classify_question_to_wire(question);
        let reply: v1::ClassifyReply =
            self.question(&question.map_id, "classify", "ClassifyRequest", &message).await?;
        Ok(reply.into())
    }

    /// One map's counters.
    pub async fn map_stats(&self, map_id: &str) -> Result<MapReport> {
        let message = v1::GetMapStatsRequest { map_id: map_id.into() };
        let reply = self.question(map_id, "stats", "GetMapStatsRequest", &message).await?;
        map_stats_from_wire(reply)
    }

    /// The box around everything that a map has observed; empty for an empty map.
    pub async fn bounds(&self, map_id: &str) -> Result<Aabb> {
        Ok(self.map_stats(map_id).await?.summary.bounds)
    }

    /// Asks one server, whichever serves the map.
    async fn question<A: Message + Default>(
        &self,
        map_id: &str,
        verb: &str,
        request: &str,
        message: &impl Message,
    ) -> Result<A> {
        let key = self.bus.keys().question(map_id, verb);
        let selector = format!("{key}?timeout_ms={}", ANSWER.as_millis());
        let replies = self
            .bus
            .session()
            .get(selector)
            .payload(message.encode_to_vec())
            .encoding(encoding_of(request))
            .target(QueryTarget::BestMatching)
            .priority(Priority::InteractiveHigh)
            .express(true)
            .timeout(ANSWER)
            .await
            .map_err(|e| bus_error(&key, &e))?;
        match replies.recv_async().await {
            Ok(reply) => answer_of(reply),
            Err(_) => Err(Error::Unavailable(format!("no server answers at {key}"))),
        }
    }
}

/// What a reply says: an answer, a refusal of the server's, or what Zenoh says in its place.
fn answer_of<A: Message + Default>(reply: Reply) -> Result<A> {
    let refused = match reply.into_result() {
        Ok(sample) => return read_message(Slices::of(sample.payload())),
        Err(refused) => refused,
    };
    if *refused.encoding() == encoding_of("QueryError") {
        return Err(refusal_from_wire(read_message(Slices::of(refused.payload()))?));
    }
    let said = match *refused.encoding() == Encoding::ZENOH_STRING {
        true => refused.payload().try_to_string().unwrap_or_default().into_owned(),
        false => "an error that is not one of ours".into(),
    };
    Err(Error::DeadlineExceeded(format!("no answer over Zenoh: {said}")))
}

impl TakesFrames for ZenohClient {
    /// Acks that do not come are told after a while as acks without a status.
    async fn stream_frames(
        &self,
        frames: impl Stream<Item = v1::Frame> + Send + 'static,
    ) -> Result<Acks> {
        Ok(Acks::of_bus(frames::put_all(self.bus.clone(), frames)))
    }
}
