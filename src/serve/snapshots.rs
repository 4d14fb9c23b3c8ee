//! Snapshots over gRPC.

use std::time::Instant;

use bytes::Bytes;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Request, Response, Status, Streaming};

use super::grpc::Edge;
use crate::error::{Error, Result};
use crate::service::{Download, Service};
use crate::storage::Snapshot;
use crate::wire::v1::snapshots_server::Snapshots;
use crate::wire::{
    Ending, created_to_wire, restored_to_wire, snapshot_list_to_wire, status_from_error,
    uploaded_to_wire, v1,
};

/// Pieces of one file that wait to be read by its client.
const WAITING: usize = 2;

type Piece = std::result::Result<v1::DownloadSnapshotReply, Status>;

#[tonic::async_trait]
impl Snapshots for Edge {
    async fn create(
        &self,
        request: Request<v1::CreateSnapshotRequest>,
    ) -> std::result::Result<Response<v1::CreateSnapshotReply>, Status> {
        let started = Instant::now();
        let v1::CreateSnapshotRequest { map_id, name } = request.into_inner();
        let name = (!name.is_empty()).then_some(name.as_str());
        let made = self.service.create_snapshot(&map_id, name).await;
        answer(made.map(|snapshot| created_to_wire(snapshot, started.elapsed())))
    }

    async fn list(
        &self,
        request: Request<v1::ListSnapshotsRequest>,
    ) -> std::result::Result<Response<v1::ListSnapshotsReply>, Status> {
        let started = Instant::now();
        let list = self.service.list_snapshots(&request.into_inner().map_id).await;
        answer(list.map(|list| snapshot_list_to_wire(list, started.elapsed())))
    }

    async fn delete(
        &self,
        request: Request<v1::DeleteSnapshotRequest>,
    ) -> std::result::Result<Response<v1::DeleteSnapshotReply>, Status> {
        let started = Instant::now();
        let v1::DeleteSnapshotRequest { map_id, name } = request.into_inner();
        let deleted = self.service.delete_snapshot(&map_id, &name).await;
        answer(
            deleted.map(|()| v1::DeleteSnapshotReply {
                server_us: started.elapsed().as_micros() as u64,
            }),
        )
    }

    type DownloadStream = ReceiverStream<Piece>;

    async fn download(
        &self,
        request: Request<v1::DownloadSnapshotRequest>,
    ) -> std::result::Result<Response<Self::DownloadStream>, Status> {
        let ending = Ending::of(&request, self.closing.clone());
        let v1::DownloadSnapshotRequest { map_id, name } = request.into_inner();
        let download = self.service.download_snapshot(&map_id, &name).await;
        let download = download.map_err(|e| status_from_error(&e))?;
        let (out, pieces) = mpsc::channel(WAITING);
        tokio::spawn(send(download, ending, out));
        Ok(Response::new(ReceiverStream::new(pieces)))
    }

    async fn upload(
        &self,
        request: Request<Streaming<v1::UploadSnapshotRequest>>,
    ) -> std::result::Result<Response<v1::UploadSnapshotReply>, Status> {
        let started = Instant::now();
        let mut ending = Ending::of(&request, self.closing.clone());
        let taken = tokio::select! {
            taken = receive(&self.service, request.into_inner()) => taken?,
            status = ending.wait() => return Err(status),
        };
        Ok(Response::new(uploaded_to_wire(taken, started.elapsed())))
    }

    async fn restore(
        &self,
        request: Request<v1::RestoreSnapshotRequest>,
    ) -> std::result::Result<Response<v1::RestoreSnapshotReply>, Status> {
        let started = Instant::now();
        let v1::RestoreSnapshotRequest { map_id, name } = request.into_inner();
        let restored = self.service.restore_snapshot(&map_id, &name).await;
        answer(restored.map(|emptied| restored_to_wire(emptied, started.elapsed())))
    }
}

fn answer<T>(answer: Result<T>) -> std::result::Result<Response<T>, Status> {
    answer.map(Response::new).map_err(|e| status_from_error(&e))
}

/// Sends a file as fast as it is read.
async fn send(mut download: Download, mut ending: Ending, out: mpsc::Sender<Piece>) {
    let mut bytes = download.bytes;
    loop {
        let piece = tokio::select! {
            piece = download.next() => piece.map_err(|e| status_from_error(&e)),
            status = ending.wait() => Err(status),
            () = out.closed() => return,
        };
        let message = match piece {
            Ok(Some(data)) => {
                let data = data.to_vec();
                Ok(v1::DownloadSnapshotReply { bytes: std::mem::take(&mut bytes), data })
            }
            Ok(None) => return,
            Err(status) => Err(status),
        };
        let is_last = message.is_err();
        if out.send(message).await.is_err() || is_last {
            return;
        }
    }
}

/// Takes in a file.
async fn receive(
    service: &Service,
    mut messages: Streaming<v1::UploadSnapshotRequest>,
) -> std::result::Result<Snapshot, Status> {
    let wrong = |e: Error| status_from_error(&e);
    let first = messages.message().await?;
    let first = first.ok_or_else(|| wrong(Error::invalid("map_id", "is required")))?;
    let mut upload = service.upload_snapshot(&first.map_id, &first.name).await.map_err(wrong)?;
    let mut next = Some(first.data);
    while let Some(data) = next {
        if !data.is_empty() {
            upload = upload.write(Bytes::from(data)).await.map_err(wrong)?;
        }
        next = messages.message().await?.map(|message| message.data);
    }
    upload.finish().await.map_err(wrong)
}
