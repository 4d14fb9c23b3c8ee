//! Views over gRPC for those who follow a map: what changed, as fast as it is read.

use std::ops::ControlFlow;
use std::sync::Arc;

use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Request, Response, Status};

use super::grpc::Edge;
use crate::error::Error;
use crate::map::{Copied, MapView};
use crate::service::Follower;
use crate::wire::v1::mirror_server::Mirror;
use crate::wire::{
    Ending, Subscription, end_to_wire, head_to_wire, part_to_wire, status_from_error, v1,
};

/// About what a part holds, bytes.
const PART_BYTES: usize = 256 << 10;
/// Messages of one reader that wait to be read. With the one at hand and those in the windows of its
/// connection that is what a slow reader costs, beside the view that it was told last.
const WAITING: usize = 4;

type Told = Result<v1::MirrorMessage, Status>;

#[tonic::async_trait]
impl Mirror for Edge {
    type SubscribeStream = ReceiverStream<Told>;

    async fn subscribe(
        &self,
        request: Request<v1::SubscribeRequest>,
    ) -> Result<Response<Self::SubscribeStream>, Status> {
        let ending = Ending::of(&request, self.closing.clone());
        let Subscription { map_id, copied, min_interval } = request.into_inner().into();
        let follower =
            self.service.follow(&map_id, min_interval).map_err(|e| status_from_error(&e))?;
        let (out, messages) = mpsc::channel(WAITING);
        tokio::spawn(tell_all(follower, copied, ending, out));
        Ok(Response::new(ReceiverStream::new(messages)))
    }
}

async fn tell_all(
    mut follower: Follower,
    copied: Copied,
    mut ending: Ending,
    out: mpsc::Sender<Told>,
) {
    loop {
        let next = tokio::select! {
            next = follower.next() => next.ok_or_else(|| Status::unavailable("the map is closed")),
            status = ending.wait() => Err(status),
            () = out.closed() => return,
        };
        let (view, old) = match next {
            Ok(views) => views,
            Err(status) => return drop(out.send(Err(status)).await),
        };
        // A thread of its own: telling takes as long as the reader takes to read.
        let to = out.clone();
        let telling = tokio::task::spawn_blocking(move || tell(&view, old, copied, &to));
        if !telling.await.is_ok_and(|told| told.is_continue()) {
            return;
        }
    }
}

/// One update; breaks once nobody reads any more.
fn tell(
    view: &MapView,
    old: Option<Arc<MapView>>,
    copied: Copied,
    out: &mpsc::Sender<Told>,
) -> ControlFlow<()> {
    let changes = view.changes(old.as_deref(), copied);
    let send = |message: Result<v1::MirrorMessage, Error>| {
        let message = message.map_err(|error| status_from_error(&error));
        match out.blocking_send(message) {
            Ok(()) => ControlFlow::Continue(()),
            Err(_) => ControlFlow::Break(()),
        }
    };
    send(head_to_wire(&changes.head()))?;
    changes.parts(PART_BYTES, &mut |part| send(Ok(part_to_wire(part))))?;
    send(Ok(end_to_wire(view.epoch())))
}
