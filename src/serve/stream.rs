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
use crate::wire::{
    Ending, stream_image_question_from_wire, stream_image_reply_to_wire, stream_reply_to_wire, v1,
};

/// The answers of a stream, in the order of its questions.
pub(super) type Answers<A> = Pin<Box<dyn Stream<Item = Result<A, Status>> + Send + 'static>>;

/// A question that comes in a stream.
pub(super) trait Streamed: Sized + Send + 'static {
    type Reply: Send + 'static;
    /// Questions of one stream that are worked on or whose answers wait to be read.
    const IN_FLIGHT: usize;
    /// What they share out among them; a question that is larger has the stream to itself.
    const ROOM: u32;

    /// How much of the room it takes.
    fn size(&self) -> usize;

    /// What becomes of it.
    fn answer(self, service: Arc<Service>) -> impl Future<Output = Self::Reply> + Send;
}

/// Room for points. With every column an answer takes 33 bytes a point.
impl Streamed for v1::StreamQueryRequest {
    type Reply = v1::StreamQueryReply;
    const IN_FLIGHT: usize = 8;
    const ROOM: u32 = 1 << 19;

    fn size(&self) -> usize {
        match &self.question {
            Some(Question::Points(question)) => question.points_m.len() / 3,
            None => 0,
        }
    }

    async fn answer(self, service: Arc<Service>) -> v1::StreamQueryReply {
        let outcome = points_reply(&service, self.question).await;
        stream_reply_to_wire(self.id, outcome)
    }
}

async fn points_reply(service: &Service, question: Option<Question>) -> error::Result<PointsReply> {
    match question {
        Some(Question::Points(question)) => {
            service.query_points(PointsQuestion::try_from(question)?, Call::GrpcStreamQuery).await
        }
        None => Err(Error::invalid("question", "is required: points")),
    }
}

/// Room for pixels. One is drawn while the one before it is read.
impl Streamed for v1::RenderStreamRequest {
    type Reply = v1::RenderStreamReply;
    const IN_FLIGHT: usize = 2;
    const ROOM: u32 = 4_000_000;

    fn size(&self) -> usize {
        let intrinsics = self.request.as_ref().and_then(|request| request.intrinsics.as_ref());
        intrinsics.map_or(0, |k| (k.width as usize).saturating_mul(k.height as usize))
    }

    async fn answer(self, service: Arc<Service>) -> v1::RenderStreamReply {
        let id = self.id;
        let outcome = match stream_image_question_from_wire(self) {
            Ok(question) => service.render(question, Call::GrpcRenderStream).await,
            Err(error) => Err(error),
        };
        stream_image_reply_to_wire(id, outcome)
    }
}

/// Reads questions as long as there is room for them; dropping the answers ends all work.
pub(super) fn answer_stream<Q: Streamed>(
    service: Arc<Service>,
    questions: Streaming<Q>,
    ending: Ending,
) -> Answers<Q::Reply> {
    // One place more than questions, for the status that ends the stream: sending never waits.
    let (pending, answers) = mpsc::channel(Q::IN_FLIGHT + 1);
    let reader = Reader {
        service,
        questions,
        slots: Arc::new(Semaphore::new(Q::IN_FLIGHT)),
        room: Arc::new(Semaphore::new(Q::ROOM as usize)),
    };
    tokio::spawn(pump(reader, ending, pending));
    Box::pin(ReceiverStream::new(answers).then(Pending::outcome))
}

/// What will be sent: an answer on its way, or the end.
enum Pending<A> {
    Answer { work: Work<A>, _room: [OwnedSemaphorePermit; 2] },
    End(Status),
}

impl<A> Pending<A> {
    /// Waits for the answer, and gives its room back.
    async fn outcome(self) -> Result<A, Status> {
        match self {
            Self::Answer { work, .. } => work.outcome().await,
            Self::End(status) => Err(status),
        }
    }
}

async fn pump<Q: Streamed>(
    mut reader: Reader<Q>,
    mut ending: Ending,
    pending: mpsc::Sender<Pending<Q::Reply>>,
) {
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

struct Reader<Q> {
    service: Arc<Service>,
    questions: Streaming<Q>,
    slots: Arc<Semaphore>,
    room: Arc<Semaphore>,
}

impl<Q: Streamed> Reader<Q> {
    /// The next question, set to work; `None` after the last. It is read once a slot is free, and
    /// worked on once there is room for its size.
    async fn next(&mut self) -> Result<Option<Pending<Q::Reply>>, Status> {
        let slot = self.slots.clone().acquire_owned().await.map_err(closed)?;
        let Some(question) = self.questions.message().await? else { return Ok(None) };
        let share = u32::try_from(question.size()).unwrap_or(u32::MAX).min(Q::ROOM);
        let room = self.room.clone().acquire_many_owned(share).await.map_err(closed)?;
        let work = Work(tokio::spawn(question.answer(self.service.clone())));
        Ok(Some(Pending::Answer { work, _room: [slot, room] }))
    }
}

/// Nobody closes these semaphores.
fn closed(error: tokio::sync::AcquireError) -> Status {
    Status::internal(error.to_string())
}

/// A task that ends with its stream.
struct Work<A>(JoinHandle<A>);

impl<A> Work<A> {
    async fn outcome(mut self) -> Result<A, Status> {
        (&mut self.0).await.map_err(|_| Status::internal("this question made the server fail"))
    }
}

impl<A> Drop for Work<A> {
    fn drop(&mut self) {
        self.0.abort();
    }
}
