from orenx.v1 import geometry_pb2 as _geometry_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class StampMode(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    STAMP_MODE_UNSPECIFIED: _ClassVar[StampMode]
    STAMP_MODE_ADD: _ClassVar[StampMode]
    STAMP_MODE_FREE: _ClassVar[StampMode]
STAMP_MODE_UNSPECIFIED: StampMode
STAMP_MODE_ADD: StampMode
STAMP_MODE_FREE: StampMode

class ClearRegionRequest(_message.Message):
    __slots__ = ("map_id", "box", "sphere", "robot_id", "older_than_ns")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    BOX_FIELD_NUMBER: _ClassVar[int]
    SPHERE_FIELD_NUMBER: _ClassVar[int]
    ROBOT_ID_FIELD_NUMBER: _ClassVar[int]
    OLDER_THAN_NS_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    box: _geometry_pb2.Aabb
    sphere: Sphere
    robot_id: str
    older_than_ns: int
    def __init__(self, map_id: _Optional[str] = ..., box: _Optional[_Union[_geometry_pb2.Aabb, _Mapping]] = ..., sphere: _Optional[_Union[Sphere, _Mapping]] = ..., robot_id: _Optional[str] = ..., older_than_ns: _Optional[int] = ...) -> None: ...

class Sphere(_message.Message):
    __slots__ = ("center", "radius_m")
    CENTER_FIELD_NUMBER: _ClassVar[int]
    RADIUS_M_FIELD_NUMBER: _ClassVar[int]
    center: _geometry_pb2.Vector3
    radius_m: float
    def __init__(self, center: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., radius_m: _Optional[float] = ...) -> None: ...

class StampGeometryRequest(_message.Message):
    __slots__ = ("map_id", "box", "sphere", "mesh", "mode", "robot_id", "color")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    BOX_FIELD_NUMBER: _ClassVar[int]
    SPHERE_FIELD_NUMBER: _ClassVar[int]
    MESH_FIELD_NUMBER: _ClassVar[int]
    MODE_FIELD_NUMBER: _ClassVar[int]
    ROBOT_ID_FIELD_NUMBER: _ClassVar[int]
    COLOR_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    box: OrientedSolidBox
    sphere: Sphere
    mesh: TriangleMesh
    mode: StampMode
    robot_id: str
    color: StampColor
    def __init__(self, map_id: _Optional[str] = ..., box: _Optional[_Union[OrientedSolidBox, _Mapping]] = ..., sphere: _Optional[_Union[Sphere, _Mapping]] = ..., mesh: _Optional[_Union[TriangleMesh, _Mapping]] = ..., mode: _Optional[_Union[StampMode, str]] = ..., robot_id: _Optional[str] = ..., color: _Optional[_Union[StampColor, _Mapping]] = ...) -> None: ...

class OrientedSolidBox(_message.Message):
    __slots__ = ("world_from_box", "size_m")
    WORLD_FROM_BOX_FIELD_NUMBER: _ClassVar[int]
    SIZE_M_FIELD_NUMBER: _ClassVar[int]
    world_from_box: _geometry_pb2.Pose
    size_m: _geometry_pb2.Vector3
    def __init__(self, world_from_box: _Optional[_Union[_geometry_pb2.Pose, _Mapping]] = ..., size_m: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ...) -> None: ...

class TriangleMesh(_message.Message):
    __slots__ = ("vertices_m", "triangles")
    VERTICES_M_FIELD_NUMBER: _ClassVar[int]
    TRIANGLES_FIELD_NUMBER: _ClassVar[int]
    vertices_m: _containers.RepeatedScalarFieldContainer[float]
    triangles: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, vertices_m: _Optional[_Iterable[float]] = ..., triangles: _Optional[_Iterable[int]] = ...) -> None: ...

class StampColor(_message.Message):
    __slots__ = ("r", "g", "b")
    R_FIELD_NUMBER: _ClassVar[int]
    G_FIELD_NUMBER: _ClassVar[int]
    B_FIELD_NUMBER: _ClassVar[int]
    r: float
    g: float
    b: float
    def __init__(self, r: _Optional[float] = ..., g: _Optional[float] = ..., b: _Optional[float] = ...) -> None: ...

class EditReply(_message.Message):
    __slots__ = ("epoch", "surfels_removed", "surfels_added", "cells_forgotten", "cells_told", "key_frames_dropped", "server_us")
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    SURFELS_REMOVED_FIELD_NUMBER: _ClassVar[int]
    SURFELS_ADDED_FIELD_NUMBER: _ClassVar[int]
    CELLS_FORGOTTEN_FIELD_NUMBER: _ClassVar[int]
    CELLS_TOLD_FIELD_NUMBER: _ClassVar[int]
    KEY_FRAMES_DROPPED_FIELD_NUMBER: _ClassVar[int]
    SERVER_US_FIELD_NUMBER: _ClassVar[int]
    epoch: int
    surfels_removed: int
    surfels_added: int
    cells_forgotten: int
    cells_told: int
    key_frames_dropped: int
    server_us: int
    def __init__(self, epoch: _Optional[int] = ..., surfels_removed: _Optional[int] = ..., surfels_added: _Optional[int] = ..., cells_forgotten: _Optional[int] = ..., cells_told: _Optional[int] = ..., key_frames_dropped: _Optional[int] = ..., server_us: _Optional[int] = ...) -> None: ...

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
    __slots__ = ("map", "frames", "frames_empty", "steps", "voxels", "rows", "surfels", "key_frames", "map_bytes", "voxels_refused", "losses", "stages_ms", "counts", "resident_bytes", "epoch", "newest_stamp_ns", "server_us", "robots", "storage_problem", "storage")
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
    STORAGE_PROBLEM_FIELD_NUMBER: _ClassVar[int]
    STORAGE_FIELD_NUMBER: _ClassVar[int]
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
    storage_problem: str
    storage: MapStorage
    def __init__(self, map: _Optional[_Union[MapSummary, _Mapping]] = ..., frames: _Optional[int] = ..., frames_empty: _Optional[int] = ..., steps: _Optional[int] = ..., voxels: _Optional[int] = ..., rows: _Optional[int] = ..., surfels: _Optional[int] = ..., key_frames: _Optional[int] = ..., map_bytes: _Optional[int] = ..., voxels_refused: _Optional[int] = ..., losses: _Optional[_Iterable[_Union[NamedValue, _Mapping]]] = ..., stages_ms: _Optional[_Iterable[_Union[NamedValue, _Mapping]]] = ..., counts: _Optional[_Union[FrameCounts, _Mapping]] = ..., resident_bytes: _Optional[int] = ..., epoch: _Optional[int] = ..., newest_stamp_ns: _Optional[int] = ..., server_us: _Optional[int] = ..., robots: _Optional[_Iterable[_Union[RobotReport, _Mapping]]] = ..., storage_problem: _Optional[str] = ..., storage: _Optional[_Union[MapStorage, _Mapping]] = ...) -> None: ...

class MapStorage(_message.Message):
    __slots__ = ("saved_epoch", "saved_ns", "journal", "journal_bytes", "journal_frames", "recovery")
    SAVED_EPOCH_FIELD_NUMBER: _ClassVar[int]
    SAVED_NS_FIELD_NUMBER: _ClassVar[int]
    JOURNAL_FIELD_NUMBER: _ClassVar[int]
    JOURNAL_BYTES_FIELD_NUMBER: _ClassVar[int]
    JOURNAL_FRAMES_FIELD_NUMBER: _ClassVar[int]
    RECOVERY_FIELD_NUMBER: _ClassVar[int]
    saved_epoch: int
    saved_ns: int
    journal: bool
    journal_bytes: int
    journal_frames: int
    recovery: str
    def __init__(self, saved_epoch: _Optional[int] = ..., saved_ns: _Optional[int] = ..., journal: bool = ..., journal_bytes: _Optional[int] = ..., journal_frames: _Optional[int] = ..., recovery: _Optional[str] = ...) -> None: ...

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
