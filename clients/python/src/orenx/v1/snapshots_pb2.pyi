from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Snapshot(_message.Message):
    __slots__ = ("name", "bytes", "created_ns", "epoch", "frames", "problem")
    NAME_FIELD_NUMBER: _ClassVar[int]
    BYTES_FIELD_NUMBER: _ClassVar[int]
    CREATED_NS_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    FRAMES_FIELD_NUMBER: _ClassVar[int]
    PROBLEM_FIELD_NUMBER: _ClassVar[int]
    name: str
    bytes: int
    created_ns: int
    epoch: int
    frames: int
    problem: str
    def __init__(self, name: _Optional[str] = ..., bytes: _Optional[int] = ..., created_ns: _Optional[int] = ..., epoch: _Optional[int] = ..., frames: _Optional[int] = ..., problem: _Optional[str] = ...) -> None: ...

class CreateSnapshotRequest(_message.Message):
    __slots__ = ("map_id", "name")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    name: str
    def __init__(self, map_id: _Optional[str] = ..., name: _Optional[str] = ...) -> None: ...

class CreateSnapshotReply(_message.Message):
    __slots__ = ("snapshot", "server_us")
    SNAPSHOT_FIELD_NUMBER: _ClassVar[int]
    SERVER_US_FIELD_NUMBER: _ClassVar[int]
    snapshot: Snapshot
    server_us: int
    def __init__(self, snapshot: _Optional[_Union[Snapshot, _Mapping]] = ..., server_us: _Optional[int] = ...) -> None: ...

class ListSnapshotsRequest(_message.Message):
    __slots__ = ("map_id",)
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    def __init__(self, map_id: _Optional[str] = ...) -> None: ...

class ListSnapshotsReply(_message.Message):
    __slots__ = ("snapshots", "server_us")
    SNAPSHOTS_FIELD_NUMBER: _ClassVar[int]
    SERVER_US_FIELD_NUMBER: _ClassVar[int]
    snapshots: _containers.RepeatedCompositeFieldContainer[Snapshot]
    server_us: int
    def __init__(self, snapshots: _Optional[_Iterable[_Union[Snapshot, _Mapping]]] = ..., server_us: _Optional[int] = ...) -> None: ...

class DeleteSnapshotRequest(_message.Message):
    __slots__ = ("map_id", "name")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    name: str
    def __init__(self, map_id: _Optional[str] = ..., name: _Optional[str] = ...) -> None: ...

class DeleteSnapshotReply(_message.Message):
    __slots__ = ("server_us",)
    SERVER_US_FIELD_NUMBER: _ClassVar[int]
    server_us: int
    def __init__(self, server_us: _Optional[int] = ...) -> None: ...

class DownloadSnapshotRequest(_message.Message):
    __slots__ = ("map_id", "name")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    name: str
    def __init__(self, map_id: _Optional[str] = ..., name: _Optional[str] = ...) -> None: ...

class DownloadSnapshotReply(_message.Message):
    __slots__ = ("bytes", "data")
    BYTES_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    bytes: int
    data: bytes
    def __init__(self, bytes: _Optional[int] = ..., data: _Optional[bytes] = ...) -> None: ...

class UploadSnapshotRequest(_message.Message):
    __slots__ = ("map_id", "name", "data")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    name: str
    data: bytes
    def __init__(self, map_id: _Optional[str] = ..., name: _Optional[str] = ..., data: _Optional[bytes] = ...) -> None: ...

class UploadSnapshotReply(_message.Message):
    __slots__ = ("snapshot", "server_us")
    SNAPSHOT_FIELD_NUMBER: _ClassVar[int]
    SERVER_US_FIELD_NUMBER: _ClassVar[int]
    snapshot: Snapshot
    server_us: int
    def __init__(self, snapshot: _Optional[_Union[Snapshot, _Mapping]] = ..., server_us: _Optional[int] = ...) -> None: ...

class RestoreSnapshotRequest(_message.Message):
    __slots__ = ("map_id", "name")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    name: str
    def __init__(self, map_id: _Optional[str] = ..., name: _Optional[str] = ...) -> None: ...

class RestoreSnapshotReply(_message.Message):
    __slots__ = ("epoch", "frames_dropped", "server_us")
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    FRAMES_DROPPED_FIELD_NUMBER: _ClassVar[int]
    SERVER_US_FIELD_NUMBER: _ClassVar[int]
    epoch: int
    frames_dropped: int
    server_us: int
    def __init__(self, epoch: _Optional[int] = ..., frames_dropped: _Optional[int] = ..., server_us: _Optional[int] = ...) -> None: ...
