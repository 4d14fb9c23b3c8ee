"""Maps as files (snapshots.proto): kept under names, sent, taken in, and made the map again."""

from __future__ import annotations

from dataclasses import dataclass

from ..v1 import snapshots_pb2
from . import Ask
from .maps import Reset


@dataclass(frozen=True)
class Snapshot:
    """A map as it was, in a file of the server."""

    name: str
    bytes: int
    # When its file was written on this server, Unix ns.
    created_ns: int
    # The map's epoch and its frames then.
    epoch: int
    frames: int
    # Why it cannot be read; empty if it can, as far as its first bytes tell.
    problem: str


@dataclass(frozen=True)
class Piece:
    """Some bytes of a file."""

    # Of the whole file; in the first piece alone.
    file_bytes: int
    data: bytes


def _snapshot(message: snapshots_pb2.Snapshot) -> Snapshot:
    m = message
    return Snapshot(m.name, m.bytes, m.created_ns, m.epoch, m.frames, m.problem)


def _read_created(data: bytes) -> Snapshot:
    return _snapshot(snapshots_pb2.CreateSnapshotReply.FromString(data).snapshot)


def _read_list(data: bytes) -> list[Snapshot]:
    reply = snapshots_pb2.ListSnapshotsReply.FromString(data)
    return [_snapshot(snapshot) for snapshot in reply.snapshots]


def _read_deleted(data: bytes) -> None:
    snapshots_pb2.DeleteSnapshotReply.FromString(data)


def _read_restored(data: bytes) -> Reset:
    reply = snapshots_pb2.RestoreSnapshotReply.FromString(data)
    return Reset(reply.epoch, reply.frames_dropped)


def _read_uploaded(data: bytes) -> Snapshot:
    return _snapshot(snapshots_pb2.UploadSnapshotReply.FromString(data).snapshot)


def _read_piece(data: bytes) -> Piece:
    reply = snapshots_pb2.DownloadSnapshotReply.FromString(data)
    return Piece(reply.bytes, bytes(reply.data))


def create_snapshot(
    map_id: str, name: str = "", *, timeout_s: float | None = None
) -> Ask[Snapshot]:
    """Writes what the map is now; without a name under one that says when."""
    request = snapshots_pb2.CreateSnapshotRequest(map_id=map_id, name=name).SerializeToString()
    method, message = "Snapshots/Create", "CreateSnapshotRequest"
    return Ask(method, None, map_id, message, request, _read_created, timeout_s)


def list_snapshots(map_id: str, *, timeout_s: float | None = None) -> Ask[list[Snapshot]]:
    """Every snapshot of the map, by name."""
    request = snapshots_pb2.ListSnapshotsRequest(map_id=map_id).SerializeToString()
    method, message = "Snapshots/List", "ListSnapshotsRequest"
    return Ask(method, None, map_id, message, request, _read_list, timeout_s)


def delete_snapshot(map_id: str, name: str, *, timeout_s: float | None = None) -> Ask[None]:
    """Deletes a snapshot."""
    request = snapshots_pb2.DeleteSnapshotRequest(map_id=map_id, name=name).SerializeToString()
    method, message = "Snapshots/Delete", "DeleteSnapshotRequest"
    return Ask(method, None, map_id, message, request, _read_deleted, timeout_s)


def restore_snapshot(map_id: str, name: str, *, timeout_s: float | None = None) -> Ask[Reset]:
    """Makes the map what a snapshot holds, its settings included, under a later epoch."""
    request = snapshots_pb2.RestoreSnapshotRequest(map_id=map_id, name=name).SerializeToString()
    method, message = "Snapshots/Restore", "RestoreSnapshotRequest"
    return Ask(method, None, map_id, message, request, _read_restored, timeout_s)


def download(map_id: str, name: str, *, timeout_s: float | None = None) -> Ask[Piece]:
    """The file, piece by piece."""
    request = snapshots_pb2.DownloadSnapshotRequest(map_id=map_id, name=name).SerializeToString()
    method, message = "Snapshots/Download", "DownloadSnapshotRequest"
    return Ask(method, None, map_id, message, request, _read_piece, timeout_s)


def upload(map_id: str, name: str, *, timeout_s: float | None = None) -> Ask[Snapshot]:
    """What begins an upload; messages of `upload_piece` follow it."""
    request = snapshots_pb2.UploadSnapshotRequest(map_id=map_id, name=name).SerializeToString()
    method, message = "Snapshots/Upload", "UploadSnapshotRequest"
    return Ask(method, None, map_id, message, request, _read_uploaded, timeout_s)


def upload_piece(data: bytes) -> bytes:
    """The next bytes of an upload, as a message."""
    return snapshots_pb2.UploadSnapshotRequest(data=data).SerializeToString()
