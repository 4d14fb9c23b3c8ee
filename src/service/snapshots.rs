//! Snapshots: made, listed, sent, taken in, deleted, and made the map again.

use std::fs::File;
use std::io::Read;
use std::sync::Arc;

use bytes::Bytes;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::Service;
use crate::engine::Emptied;
use crate::error::{Error, Result};
use crate::storage::{Receiving, Snapshot};

/// What a snapshot is sent in, bytes.
pub const PIECE_BYTES: usize = 256 << 10;
/// Snapshots on their way in or out at a time.
const MAX_TRANSFERS: usize = 8;

pub(super) fn places() -> Arc<Semaphore> {
    Arc::new(Semaphore::new(MAX_TRANSFERS))
}

impl Service {
    /// Writes a snapshot of a map; without a name, one that says when it was made.
    pub async fn create_snapshot(&self, map_id: &str, name: Option<&str>) -> Result<Snapshot> {
        let map = self.map(map_id)?;
        let shelf = self.registry.shelf(map_id)?;
        let (name, path) = shelf.place(name)?;
        map.snapshot(path).await?;
        blocking(move || shelf.describe(&name)).await
    }

    /// Every snapshot of a map, by name. Also of one that could not be loaded.
    pub async fn list_snapshots(&self, map_id: &str) -> Result<Vec<Snapshot>> {
        let shelf = self.registry.shelf(map_id)?;
        blocking(move || shelf.list()).await
    }

    /// Deletes a snapshot.
    pub async fn delete_snapshot(&self, map_id: &str, name: &str) -> Result<()> {
        let (shelf, name) = (self.registry.shelf(map_id)?, name.to_owned());
        blocking(move || shelf.delete(&name)).await
    }

    /// Makes the map what a snapshot holds, under a later epoch. Questions are answered meanwhile, from
    /// the old map. What waits is dropped. A map that could not be loaded is served again; its file is
    /// set aside.
    pub async fn restore_snapshot(&self, map_id: &str, name: &str) -> Result<Emptied> {
        self.registry.restore(map_id, name).await
    }

    /// Opens a snapshot to send it.
    pub async fn download_snapshot(&self, map_id: &str, name: &str) -> Result<Download> {
        let (shelf, name) = (self.registry.shelf(map_id)?, name.to_owned());
        let place = self.transfer()?;
        blocking(move || {
            let path = shelf.find(&name)?;
            let file = File::open(&path).map_err(|e| Error::io(&path, e))?;
            let bytes = file.metadata().map_err(|e| Error::io(&path, e))?.len();
            Ok(Download { bytes, left: bytes, file: Arc::new(file), name, _place: place })
        })
        .await
    }

    /// Begins to take in a snapshot.
    pub async fn upload_snapshot(&self, map_id: &str, name: &str) -> Result<Upload> {
        let (shelf, name) = (self.registry.shelf(map_id)?, name.to_owned());
        let (place, most) = (self.transfer()?, self.max_snapshot_bytes);
        let receiving = blocking(move || shelf.receive(&name, most)).await?;
        Ok(Upload { receiving, _place: place })
    }

    fn transfer(&self) -> Result<OwnedSemaphorePermit> {
        self.transfers.clone().try_acquire_owned().map_err(|_| Error::ResourceExhausted {
            what: "snapshots on their way".into(),
            limit: format!("the limit is {MAX_TRANSFERS}"),
        })
    }
}

/// A snapshot on its way out, piece by piece.
#[derive(Debug)]
pub struct Download {
    /// Of the whole file.
    pub bytes: u64,
    left: u64,
    file: Arc<File>,
    name: String,
    _place: OwnedSemaphorePermit,
}

impl Download {
    /// The next piece; `None` after the last.
    pub async fn next(&mut self) -> Result<Option<Bytes>> {
        if self.left == 0 {
            return Ok(None);
        }
        let (file, length) = (self.file.clone(), self.left.min(PIECE_BYTES as u64) as usize);
        let name = self.name.clone();
        let piece = blocking(move || {
            let mut piece = vec![0; length];
            (&*file).read_exact(&mut piece).map_err(|e| Error::io(&name, e))?;
            Ok(Bytes::from(piece))
        });
        let piece = piece.await?;
        self.left -= length as u64;
        Ok(Some(piece))
    }
}

/// A snapshot on its way in. Dropping it leaves nothing.
#[derive(Debug)]
pub struct Upload {
    receiving: Receiving,
    _place: OwnedSemaphorePermit,
}

impl Upload {
    /// Takes the next bytes.
    pub async fn write(self, bytes: Bytes) -> Result<Self> {
        blocking(move || {
            let Self { mut receiving, _place } = self;
            receiving.write(&bytes)?;
            Ok(Self { receiving, _place })
        })
        .await
    }

    /// Checks the whole file, and only then gives it its name.
    pub async fn finish(self) -> Result<Snapshot> {
        blocking(move || self.receiving.finish()).await
    }
}

/// The disk is waited for off the network threads.
async fn blocking<T: Send + 'static>(
    work: impl FnOnce() -> Result<T> + Send + 'static,
) -> Result<T> {
    let done = tokio::task::spawn_blocking(work).await;
    done.unwrap_or_else(|_| Err(Error::Internal("work on a snapshot failed".into())))
}
