//! Frames over gRPC: one task a stream reads frames, and acks come back as the engine tells them.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::sync::mpsc::{self, OwnedPermit};
use tokio::sync::watch;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Request, Response, Status, Streaming};

use super::read::read_frame;
use crate::engine::{FrameSink, Queue, Session, Verdict};
use crate::error::Error;
use crate::service::Service;
use crate::wire::{Ending, FrameSummary, IncomingFrame, ack_to_wire, v1};

/// Acks of one stream that may wait to be read, three a frame. A client that does not read its acks
/// stops being read when they are used up.
const ACKS: usize = 192;

type Ack = Result<v1::FrameAck, Status>;

/// `orenx.v1.Ingest`.
pub struct IngestService {
    service: Arc<Service>,
    closing: watch::Receiver<bool>,
}

impl IngestService {
    /// `closing` turns true when streams must end.
    pub fn new(service: Arc<Service>, closing: watch::Receiver<bool>) -> Self {
        Self { service, closing }
    }
}

#[tonic::async_trait]
impl v1::ingest_server::Ingest for IngestService {
    type StreamFramesStream = ReceiverStream<Ack>;

    async fn stream_frames(
        &self,
        request: Request<Streaming<v1::Frame>>,
    ) -> Result<Response<Self::StreamFramesStream>, Status> {
        let (acks, outgoing) = mpsc::channel(ACKS);
        let stream = FrameStream {
            session: self.service.session(),
            service: self.service.clone(),
            ending: Ending::of(&request, self.closing.clone()),
            frames: request.into_inner(),
            acks,
        };
        tokio::spawn(stream.pump());
        Ok(Response::new(ReceiverStream::new(outgoing)))
    }
}

struct FrameStream {
    session: Session,
    service: Arc<Service>,
    ending: Ending,
    frames: Streaming<v1::Frame>,
    acks: mpsc::Sender<Ack>,
}

impl FrameStream {
    /// Reads frames until the client or the server ends. Room for all acks of a frame is reserved
    /// before it is read, so that telling them never blocks and never fails; acks still to come
    /// keep the stream open after this ends.
    async fn pump(mut self) {
        loop {
            let Ok(accepted) = self.acks.clone().reserve_owned().await else { return };
            let Ok(durable) = self.acks.clone().reserve_owned().await else { return };
            let Ok(settled) = self.acks.clone().reserve_owned().await else { return };
            let next = tokio::select! {
                next = self.frames.message() => next,
                status = self.ending.wait() => Err(status),
            };
            match next {
                Ok(Some(message)) => {
                    let frame = FrameSummary::from(&message);
                    let sink = AckSink {
                        service: self.service.clone(),
                        map_id: message.map_id.clone(),
                        arrived: Instant::now(),
                        queue: self.service.queue(
                            &message.map_id,
                            &frame.robot_id,
                            &frame.sensor_id,
                        ),
                        frame,
                        accepted: Some(accepted),
                        durable: Some(durable),
                        visible_after: None,
                        settled,
                    };
                    match self.take(message, Box::new(sink)).await {
                        ControlFlow::Continue(()) => {}
                        ControlFlow::Break(Some(status)) => return self.close(status).await,
                        ControlFlow::Break(None) => return,
                    }
                }
                Ok(None) => return,
                Err(status) => {
                    drop((accepted, durable, settled));
                    return self.close(status).await;
                }
            }
        }
    }

    /// Brings one frame to its lane or its refusal, unless the stream is over before. Decoding images
    /// and embedding names take milliseconds and must not hold up the answers to others.
    async fn take(
        &mut self,
        message: v1::Frame,
        sink: Box<AckSink>,
    ) -> ControlFlow<Option<Status>> {
        let arrived = sink.arrived;
        let map_id = sink.map_id.clone();
        let reader = self.service.clone();
        let decoded = tokio::task::spawn_blocking(move || read_frame(&reader, message)).await;
        let incoming =
            decoded.unwrap_or_else(|_| Err(Error::Internal("decoding this frame failed".into())));
        let Self { service, session, ending, acks, .. } = self;
        let submitted = async {
            match incoming {
                Ok(IncomingFrame { policy, frame, .. }) => {
                    service.submit_frame(*session, &map_id, frame, policy, sink, arrived).await;
                }
                Err(error) => service.refuse_frame(&map_id, error, sink, arrived),
            }
        };
        unless_over(submitted, acks, ending).await
    }

    /// Ends the stream with a status, after every ack was read.
    async fn close(self, status: Status) {
        if let Ok(mut permits) = self.acks.reserve_many(ACKS).await
            && let Some(permit) = permits.next()
        {
            permit.send(Err(status));
        }
    }
}

/// Waits for `work`, or for the end of its stream: with a status, or without one where the client has
/// left. What is done goes first, so that a server on its way down tells why a frame was dropped.
async fn unless_over(
    work: impl Future<Output = ()>,
    acks: &mpsc::Sender<Ack>,
    ending: &mut Ending,
) -> ControlFlow<Option<Status>> {
    tokio::select! {
        biased;
        () = work => ControlFlow::Continue(()),
        () = acks.closed() => ControlFlow::Break(None),
        status = ending.wait() => ControlFlow::Break(Some(status)),
    }
}

/// Turns the news of one frame into its acks.
struct AckSink {
    service: Arc<Service>,
    map_id: String,
    frame: FrameSummary,
    arrived: Instant,
    queue: Queue,
    accepted: Option<OwnedPermit<Ack>>,
    durable: Option<OwnedPermit<Ack>>,
    /// How long it took until queries saw it.
    visible_after: Option<Duration>,
    settled: OwnedPermit<Ack>,
}

impl AckSink {
    fn ack(&self, verdict: Option<&Verdict>) -> v1::FrameAck {
        let newest = self.service.newest(&self.map_id);
        let spent = match verdict {
            Some(Verdict::Integrated { .. }) => self.visible_after,
            _ => None,
        };
        let spent = spent.unwrap_or_else(|| self.arrived.elapsed());
        ack_to_wire(&self.frame, verdict, newest, &self.queue, spent)
    }
}

impl FrameSink for AckSink {
    fn accepted(&mut self, queue: Queue) {
        self.queue = queue;
        let ack = self.ack(None);
        if let Some(permit) = self.accepted.take() {
            permit.send(Ok(ack));
        }
    }

    fn visible(&mut self) {
        self.visible_after = Some(self.arrived.elapsed());
    }

    fn durable(&mut self) {
        let mut ack = self.ack(None);
        ack.set_status(v1::FrameStatus::Durable);
        if let Some(permit) = self.durable.take() {
            permit.send(Ok(ack));
        }
    }

    fn settle(self: Box<Self>, verdict: Verdict) {
        let ack = self.ack(Some(&verdict));
        self.settled.send(Ok(ack));
    }
}

#[cfg(test)]
mod tests {
    use std::future::{pending, ready};

    use tonic::Code;
    use tonic::codegen::http::{HeaderMap, HeaderValue};

    use super::*;
    use crate::wire::Deadline;

    /// A stream whose client waits no time at all.
    fn late(closing: &watch::Receiver<bool>) -> Ending {
        let mut request = Request::new(());
        let headers = HeaderMap::from_iter([(
            "grpc-timeout".parse().expect("a name"),
            HeaderValue::from_static("0n"),
        )]);
        Deadline::of(&headers).expect("a deadline").attach(request.extensions_mut());
        Ending::of(&request, closing.clone())
    }

    #[tokio::test]
    async fn a_frame_that_waits_for_room_waits_no_longer_than_its_stream() {
        let code = |flow| match flow {
            ControlFlow::Break(Some(status)) => Status::code(&status),
            other => panic!("{other:?}"),
        };
        let (close, closing) = watch::channel(false);
        let (acks, reader) = mpsc::channel(1);
        let flow = unless_over(pending(), &acks, &mut late(&closing)).await;
        assert_eq!(code(flow), Code::DeadlineExceeded);
        let flow = unless_over(ready(()), &acks, &mut late(&closing)).await;
        assert!(flow.is_continue(), "it was done in time");

        let mut open = Ending::of(&Request::new(()), closing);
        close.send_replace(true);
        assert_eq!(code(unless_over(pending(), &acks, &mut open).await), Code::Unavailable);
        drop(reader);
        let flow = unless_over(pending(), &acks, &mut open).await;
        assert!(matches!(flow, ControlFlow::Break(None)), "nobody is left to be told");
    }
}
