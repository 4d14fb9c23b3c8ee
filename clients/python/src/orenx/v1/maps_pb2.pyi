from orenx.v1 import geometry_pb2 as _geometry_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class ListMapsRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class ListMapsReply(_message.Message):
    __slots__ = ("maps", "server_us")
    MAPS_FIELD_NUMBER: _ClassVar[int]
    SERVER_US_FIELD_NUMBER: _ClassVar[int]
    maps: _containers.RepeatedCompositeFieldContainer[MapSummary]
    server_us: int
    def __init__(self, maps: _Optional[_Iterable[_Union[MapSummary, _Mapping]]] = ..., server_us: _Optional[int] = ...) -> None: ...

class MapSummary(_message.Message):
    __slots__ = ("map_id", "epoch", "newest_stamp_ns", "bounds", "modalities", "problem")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    NEWEST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    BOUNDS_FIELD_NUMBER: _ClassVar[int]
    MODALITIES_FIELD_NUMBER: _ClassVar[int]
    PROBLEM_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    epoch: int
    newest_stamp_ns: int
    bounds: _geometry_pb2.Aabb
    modalities: _containers.RepeatedScalarFieldContainer[str]
    problem: str
    def __init__(self, map_id: _Optional[str] = ..., epoch: _Optional[int] = ..., newest_stamp_ns: _Optional[int] = ..., bounds: _Optional[_Union[_geometry_pb2.Aabb, _Mapping]] = ..., modalities: _Optional[_Iterable[str]] = ..., problem: _Optional[str] = ...) -> None: ...

class CreateMapRequest(_message.Message):
    __slots__ = ("map_id", "settings")
    class SettingsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    SETTINGS_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    settings: _containers.ScalarMap[str, str]
    def __init__(self, map_id: _Optional[str] = ..., settings: _Optional[_Mapping[str, str]] = ...) -> None: ...

class DeleteMapRequest(_message.Message):
    __slots__ = ("map_id",)
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    def __init__(self, map_id: _Optional[str] = ...) -> None: ...

class DeleteMapReply(_message.Message):
    __slots__ = ("server_us",)
    SERVER_US_FIELD_NUMBER: _ClassVar[int]
    server_us: int
    def __init__(self, server_us: _Optional[int] = ...) -> None: ...

class GetMapRequest(_message.Message):
    __slots__ = ("map_id",)
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    def __init__(self, map_id: _Optional[str] = ...) -> None: ...

class GetMapReply(_message.Message):
    __slots__ = ("map", "settings", "epoch", "newest_stamp_ns", "server_us")
    MAP_FIELD_NUMBER: _ClassVar[int]
    SETTINGS_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    NEWEST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    SERVER_US_FIELD_NUMBER: _ClassVar[int]
    map: MapSummary
    settings: MapSettings
    epoch: int
    newest_stamp_ns: int
    server_us: int
    def __init__(self, map: _Optional[_Union[MapSummary, _Mapping]] = ..., settings: _Optional[_Union[MapSettings, _Mapping]] = ..., epoch: _Optional[int] = ..., newest_stamp_ns: _Optional[int] = ..., server_us: _Optional[int] = ...) -> None: ...

class MapSettings(_message.Message):
    __slots__ = ("profile", "schedule", "prior", "r0_m", "max_distance_m", "seed", "memory_mib")
    PROFILE_FIELD_NUMBER: _ClassVar[int]
    SCHEDULE_FIELD_NUMBER: _ClassVar[int]
    PRIOR_FIELD_NUMBER: _ClassVar[int]
    R0_M_FIELD_NUMBER: _ClassVar[int]
    MAX_DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    MEMORY_MIB_FIELD_NUMBER: _ClassVar[int]
    profile: str
    schedule: str
    prior: str
    r0_m: float
    max_distance_m: float
    seed: int
    memory_mib: int
    def __init__(self, profile: _Optional[str] = ..., schedule: _Optional[str] = ..., prior: _Optional[str] = ..., r0_m: _Optional[float] = ..., max_distance_m: _Optional[float] = ..., seed: _Optional[int] = ..., memory_mib: _Optional[int] = ...) -> None: ...

class ResetMapRequest(_message.Message):
    __slots__ = ("map_id",)
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    def __init__(self, map_id: _Optional[str] = ...) -> None: ...

class ResetMapReply(_message.Message):
    __slots__ = ("epoch", "frames_dropped", "server_us")
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    FRAMES_DROPPED_FIELD_NUMBER: _ClassVar[int]
    SERVER_US_FIELD_NUMBER: _ClassVar[int]
    epoch: int
    frames_dropped: int
    server_us: int
    def __init__(self, epoch: _Optional[int] = ..., frames_dropped: _Optional[int] = ..., server_us: _Optional[int] = ...) -> None: ...

class GetMapStatsRequest(_message.Message):
    __slots__ = ("map_id",)
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    def __init__(self, map_id: _Optional[str] = ...) -> None: ...

class GetMapStatsReply(_message.Message):
    __slots__ = ("map", "frames", "frames_empty", "steps", "voxels", "rows", "surfels", "key_frames", "map_bytes", "voxels_refused", "losses", "stages_ms", "counts", "resident_bytes", "epoch", "newest_stamp_ns", "server_us", "robots")
    MAP_FIELD_NUMBER: _ClassVar[int]
    FRAMES_FIELD_NUMBER: _ClassVar[int]
    FRAMES_EMPTY_FIELD_NUMBER: _ClassVar[int]
    STEPS_FIELD_NUMBER: _ClassVar[int]
    VOXELS_FIELD_NUMBER: _ClassVar[int]
    ROWS_FIELD_NUMBER: _ClassVar[int]
    SURFELS_FIELD_NUMBER: _ClassVar[int]
    KEY_FRAMES_FIELD_NUMBER: _ClassVar[int]
    MAP_BYTES_FIELD_NUMBER: _ClassVar[int]
    VOXELS_REFUSED_FIELD_NUMBER: _ClassVar[int]
    LOSSES_FIELD_NUMBER: _ClassVar[int]
    STAGES_MS_FIELD_NUMBER: _ClassVar[int]
    COUNTS_FIELD_NUMBER: _ClassVar[int]
    RESIDENT_BYTES_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    NEWEST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    SERVER_US_FIELD_NUMBER: _ClassVar[int]
    ROBOTS_FIELD_NUMBER: _ClassVar[int]
    map: MapSummary
    frames: int
    frames_empty: int
    steps: int
    voxels: int
    rows: int
    surfels: int
    key_frames: int
    map_bytes: int
    voxels_refused: int
    losses: _containers.RepeatedCompositeFieldContainer[NamedValue]
    stages_ms: _containers.RepeatedCompositeFieldContainer[NamedValue]
    counts: FrameCounts
    resident_bytes: int
    epoch: int
    newest_stamp_ns: int
    server_us: int
    robots: _containers.RepeatedCompositeFieldContainer[RobotReport]
    def __init__(self, map: _Optional[_Union[MapSummary, _Mapping]] = ..., frames: _Optional[int] = ..., frames_empty: _Optional[int] = ..., steps: _Optional[int] = ..., voxels: _Optional[int] = ..., rows: _Optional[int] = ..., surfels: _Optional[int] = ..., key_frames: _Optional[int] = ..., map_bytes: _Optional[int] = ..., voxels_refused: _Optional[int] = ..., losses: _Optional[_Iterable[_Union[NamedValue, _Mapping]]] = ..., stages_ms: _Optional[_Iterable[_Union[NamedValue, _Mapping]]] = ..., counts: _Optional[_Union[FrameCounts, _Mapping]] = ..., resident_bytes: _Optional[int] = ..., epoch: _Optional[int] = ..., newest_stamp_ns: _Optional[int] = ..., server_us: _Optional[int] = ..., robots: _Optional[_Iterable[_Union[RobotReport, _Mapping]]] = ...) -> None: ...

class RobotReport(_message.Message):
    __slots__ = ("robot_id", "counts", "newest_stamp_ns", "sensor_id", "world_from_camera", "intrinsics")
    ROBOT_ID_FIELD_NUMBER: _ClassVar[int]
    COUNTS_FIELD_NUMBER: _ClassVar[int]
    NEWEST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    SENSOR_ID_FIELD_NUMBER: _ClassVar[int]
    WORLD_FROM_CAMERA_FIELD_NUMBER: _ClassVar[int]
    INTRINSICS_FIELD_NUMBER: _ClassVar[int]
    robot_id: str
    counts: FrameCounts
    newest_stamp_ns: int
    sensor_id: str
    world_from_camera: _geometry_pb2.Pose
    intrinsics: _geometry_pb2.Intrinsics
    def __init__(self, robot_id: _Optional[str] = ..., counts: _Optional[_Union[FrameCounts, _Mapping]] = ..., newest_stamp_ns: _Optional[int] = ..., sensor_id: _Optional[str] = ..., world_from_camera: _Optional[_Union[_geometry_pb2.Pose, _Mapping]] = ..., intrinsics: _Optional[_Union[_geometry_pb2.Intrinsics, _Mapping]] = ...) -> None: ...

class NamedValue(_message.Message):
    __slots__ = ("name", "value")
    NAME_FIELD_NUMBER: _ClassVar[int]
    VALUE_FIELD_NUMBER: _ClassVar[int]
    name: str
    value: float
    def __init__(self, name: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...

class FrameCounts(_message.Message):
    __slots__ = ("received", "integrated", "dropped", "rejected", "waiting", "lost")
    RECEIVED_FIELD_NUMBER: _ClassVar[int]
    INTEGRATED_FIELD_NUMBER: _ClassVar[int]
    DROPPED_FIELD_NUMBER: _ClassVar[int]
    REJECTED_FIELD_NUMBER: _ClassVar[int]
    WAITING_FIELD_NUMBER: _ClassVar[int]
    LOST_FIELD_NUMBER: _ClassVar[int]
    received: int
    integrated: int
    dropped: _containers.RepeatedCompositeFieldContainer[NamedCount]
    rejected: _containers.RepeatedCompositeFieldContainer[NamedCount]
    waiting: int
    lost: int
    def __init__(self, received: _Optional[int] = ..., integrated: _Optional[int] = ..., dropped: _Optional[_Iterable[_Union[NamedCount, _Mapping]]] = ..., rejected: _Optional[_Iterable[_Union[NamedCount, _Mapping]]] = ..., waiting: _Optional[int] = ..., lost: _Optional[int] = ...) -> None: ...

class NamedCount(_message.Message):
    __slots__ = ("name", "count")
    NAME_FIELD_NUMBER: _ClassVar[int]
    COUNT_FIELD_NUMBER: _ClassVar[int]
    name: str
    count: int
    def __init__(self, name: _Optional[str] = ..., count: _Optional[int] = ...) -> None: ...
