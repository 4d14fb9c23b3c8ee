//! Pipelined questions: several of a stream are worked on at a time and answered in their order.

use std::pin::Pin;
use std::sync::Arc;

use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc};
use tokio::task::JoinHandle;
use tokio_stream::wrappers::ReceiverStream;
use tokio_stream::{Stream, StreamExt};
use tonic::{Status, Streaming};

use crate::error::{self, Error};
use crate::service::{Call, PointsQuestion, PointsReply, Service};
use crate::wire::v1::stream_query_request::Question;
use crate::wire::{Ending, stream_reply_to_wire, v1};

/// Questions of one stream that are worked on or whose answers wait to be read.
const IN_FLIGHT: usize = 8;
/// Points of all of them; a question with more has the stream to itself. With every column an answer
/// takes 21 bytes a point.
const IN_FLIGHT_POINTS: u32 = 1 << 19;

/// The answers of a stream, in the order of its questions.
pub(super) type Answers =
    Pin<Box<dyn Stream<Item = Result<v1::StreamQueryReply, Status>> + Send + 'static>>;

/// Reads questions as long as there is room for them; dropping the answers ends all work.
pub(super) fn answer_stream(
    service: Arc<Service>,
    questions: Streaming<v1::StreamQueryRequest>,
    ending: Ending,
) -> Answers {
    // One place more than questions, for the status that ends the stream: sending never waits.
    let (pending, answers) = mpsc::channel(IN_FLIGHT + 1);
    let reader = Reader {
        service,
        questions,
        slots: Arc::new(Semaphore::new(IN_FLIGHT)),
        points: Arc::new(Semaphore::new(IN_FLIGHT_POINTS as usize)),
    };
    tokio::spawn(pump(reader, ending, pending));
    Box::pin(ReceiverStream::new(answers).then(Pending::outcome))
}

/// What will be sent: an answer on its way, or the end.
enum Pending {
    Answer { work: Work, _room: [OwnedSemaphorePermit; 2] },
    End(Status),
}

impl Pending {
    /// Waits for the answer, and gives its room back.
    async fn outcome(self) -> Result<v1::StreamQueryReply, Status> {
        match self {
            Self::Answer { work, .. } => work.outcome().await,
            Self::End(status) => Err(status),
        }
    }
}

async fn pump(mut reader: Reader, mut ending: Ending, pending: mpsc::Sender<Pending>) {
    loop {
        let next = tokio::select! {
            next = reader.next() => next,
            status = ending.wait() => Err(status),
            () = pending.closed() => return,
        };
        let (item, is_last) = match next {
            Ok(Some(item)) => (item, false),
            Ok(None) => return,
            Err(status) => (Pending::End(status), true),
        };
        if pending.send(item).await.is_err() || is_last {
            return;
        }
    }
}

struct Reader {
    service: Arc<Service>,
    questions: Streaming<v1::StreamQueryRequest>,
    slots: Arc<Semaphore>,
    points: Arc<Semaphore>,
}

impl Reader {
    /// The next question, set to work; `None` after the last. It is read once a slot is free, and
    /// worked on once its points have room.
    async fn next(&mut self) -> Result<Option<Pending>, Status> {
        let slot = self.slots.clone().acquire_owned().await.map_err(closed)?;
        let Some(message) = self.questions.message().await? else { return Ok(None) };
        let points = match &message.question {
            Some(Question::Points(question)) => question.points_m.len() / 3,
            None => 0,
        };
        let share = u32::try_from(points).unwrap_or(u32::MAX).min(IN_FLIGHT_POINTS);
        let room = self.points.clone().acquire_many_owned(share).await.map_err(closed)?;
        let work = Work(tokio::spawn(answer(self.service.clone(), message)));
        Ok(Some(Pending::Answer { work, _room: [slot, room] }))
    }
}

/// Nobody closes these semaphores.
fn closed(error: tokio::sync::AcquireError) -> Status {
    Status::internal(error.to_string())
}

async fn answer(service: Arc<Service>, message: v1::StreamQueryRequest) -> v1::StreamQueryReply {
    let outcome = points_reply(&service, message.question).await;
    stream_reply_to_wire(message.id, outcome)
}

async fn points_reply(service: &Service, question: Option<Question>) -> error::Result<PointsReply> {
    match question {
        Some(Question::Points(question)) => {
            service.query_points(PointsQuestion::try_from(question)?, Call::GrpcStreamQuery).await
        }
        None => Err(Error::invalid("question", "is required: points")),
    }
}

/// A task that ends with its stream.
struct Work(JoinHandle<v1::StreamQueryReply>);

impl Work {
    async fn outcome(mut self) -> Result<v1::StreamQueryReply, Status> {
        (&mut self.0).await.map_err(|_| Status::internal("this question made the server fail"))
    }
}

impl Drop for Work {
    fn drop(&mut self) {
        self.0.abort();
    }
}
