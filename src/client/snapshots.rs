//! Snapshots of a server's maps.

use std::io::{Read, Write};

use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;

use super::{Authorized, Client};
use crate::engine::Emptied;
use crate::error::{Error, Result};
use crate::service::PIECE_BYTES;
use crate::storage::Snapshot;
use crate::wire::v1::snapshots_client::SnapshotsClient;
use crate::wire::{error_from_status, snapshot_from_wire, snapshot_list_from_wire, v1};

impl Client {
    /// Writes a snapshot of a map; without a name, one that says when it was made.
    pub async fn create_snapshot(&self, map_id: &str, name: Option<&str>) -> Result<Snapshot> {
        let name = name.unwrap_or_default().to_owned();
        let request = v1::CreateSnapshotRequest { map_id: map_id.into(), name };
        let reply = self.snapshots().create(request).await.map_err(|e| error_from_status(&e))?;
        snapshot_from_wire(reply.into_inner().snapshot)
    }

    /// Every snapshot of a map.
    pub async fn list_snapshots(&self, map_id: &str) -> Result<Vec<Snapshot>> {
        let request = v1::ListSnapshotsRequest { map_id: map_id.into() };
        let reply = self.snapshots().list(request).await.map_err(|e| error_from_status(&e))?;
        Ok(snapshot_list_from_wire(reply.into_inner()))
    }

    /// Deletes a snapshot.
    pub async fn delete_snapshot(&self, map_id: &str, name: &str) -> Result<()> {
        let request = v1::DeleteSnapshotRequest { map_id: map_id.into(), name: name.into() };
        self.snapshots().delete(request).await.map_err(|e| error_from_status(&e))?;
        Ok(())
    }

    /// Makes a map what a snapshot holds; the first epoch of it, and how many waiting frames were
    /// dropped.
    pub async fn restore_snapshot(&self, map_id: &str, name: &str) -> Result<Emptied> {
        let request = v1::RestoreSnapshotRequest { map_id: map_id.into(), name: name.into() };
        let reply = self.snapshots().restore(request).await.map_err(|e| error_from_status(&e))?;
        let v1::RestoreSnapshotReply { epoch, frames_dropped, .. } = reply.into_inner();
        Ok(Emptied { epoch, frames_dropped })
    }

    /// Writes a snapshot's bytes as they come; how many there were.
    pub async fn download_snapshot(
        &self,
        map_id: &str,
        name: &str,
        out: &mut impl Write,
    ) -> Result<u64> {
        let request = v1::DownloadSnapshotRequest { map_id: map_id.into(), name: name.into() };
        let pieces = self.snapshots().download(request).await.map_err(|e| error_from_status(&e))?;
        let mut pieces = pieces.into_inner();
        let (mut expected, mut bytes) = (None, 0);
        while let Some(piece) = pieces.message().await.map_err(|e| error_from_status(&e))? {
            expected.get_or_insert(piece.bytes);
            bytes += piece.data.len() as u64;
            out.write_all(&piece.data).map_err(|e| Error::io(name, e))?;
        }
        match expected {
            Some(expected) if expected != bytes => {
                Err(Error::corrupt(name, format!("{bytes} of {expected} bytes came")))
            }
            _ => Ok(bytes),
        }
    }

    /// Sends a file, to be a snapshot of this name.
    pub async fn upload_snapshot(
        &self,
        map_id: &str,
        name: &str,
        mut file: impl Read + Send + 'static,
    ) -> Result<Snapshot> {
        let (out, messages) = mpsc::channel(2);
        let first = (map_id.to_owned(), name.to_owned());
        // A server that refuses ends the stream, and says why in its reply.
        let reading = tokio::task::spawn_blocking(move || -> std::io::Result<()> {
            let mut names = Some(first);
            loop {
                let mut data = Vec::new();
                (&mut file).take(PIECE_BYTES as u64).read_to_end(&mut data)?;
                let is_last = data.is_empty();
                let (map_id, name) = names.take().unwrap_or_default();
                let message = v1::UploadSnapshotRequest { map_id, name, data };
                if out.blocking_send(message).is_err() || is_last {
                    return Ok(());
                }
            }
        });
        let reply = self.snapshots().upload(ReceiverStream::new(messages)).await;
        let read = reading.await.map_err(|_| Error::Internal("reading a file failed".into()))?;
        read.map_err(|e| Error::io(name, e))?;
        let reply = reply.map_err(|e| error_from_status(&e))?;
        snapshot_from_wire(reply.into_inner().snapshot)
    }

    fn snapshots(&self) -> SnapshotsClient<Authorized> {
        SnapshotsClient::new(self.channel.clone())
    }
}
