//! `snapshots.proto`: maps as files.

use std::time::Duration;

use super::geometry::required;
use super::v1;
use crate::engine::Emptied;
use crate::error::Result;
use crate::storage::Snapshot;

/// The message of a snapshot.
fn snapshot_to_wire(snapshot: Snapshot) -> v1::Snapshot {
    let Snapshot { name, bytes, created_ns, epoch, frames, problem } = snapshot;
    v1::Snapshot { name, bytes, created_ns, epoch, frames, problem }
}

/// The snapshot of a message.
pub fn snapshot_from_wire(message: Option<v1::Snapshot>) -> Result<Snapshot> {
    required("snapshot", message).map(from_wire)
}

fn from_wire(message: v1::Snapshot) -> Snapshot {
    let v1::Snapshot { name, bytes, created_ns, epoch, frames, problem } = message;
    Snapshot { name, bytes, created_ns, epoch, frames, problem }
}

/// The message of a list.
pub fn snapshot_list_to_wire(list: Vec<Snapshot>, spent: Duration) -> v1::ListSnapshotsReply {
    v1::ListSnapshotsReply {
        snapshots: list.into_iter().map(snapshot_to_wire).collect(),
        server_us: spent.as_micros() as u64,
    }
}

/// The list of a message.
pub fn snapshot_list_from_wire(message: v1::ListSnapshotsReply) -> Vec<Snapshot> {
    message.snapshots.into_iter().map(from_wire).collect()
}

/// The message of a snapshot that was made.
pub fn created_to_wire(snapshot: Snapshot, spent: Duration) -> v1::CreateSnapshotReply {
    v1::CreateSnapshotReply {
        snapshot: Some(snapshot_to_wire(snapshot)),
        server_us: spent.as_micros() as u64,
    }
}

/// The message of a snapshot that was taken in.
pub fn uploaded_to_wire(snapshot: Snapshot, spent: Duration) -> v1::UploadSnapshotReply {
    v1::UploadSnapshotReply {
        snapshot: Some(snapshot_to_wire(snapshot)),
        server_us: spent.as_micros() as u64,
    }
}

/// The message of a map that became a snapshot.
pub fn restored_to_wire(emptied: Emptied, spent: Duration) -> v1::RestoreSnapshotReply {
    v1::RestoreSnapshotReply {
        epoch: emptied.epoch,
        frames_dropped: emptied.frames_dropped,
        server_us: spent.as_micros() as u64,
    }
}
