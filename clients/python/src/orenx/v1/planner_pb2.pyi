from orenx.v1 import geometry_pb2 as _geometry_pb2
from orenx.v1 import query_pb2 as _query_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class RayState(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    RAY_STATE_UNSPECIFIED: _ClassVar[RayState]
    RAY_STATE_FREE: _ClassVar[RayState]
    RAY_STATE_HIT: _ClassVar[RayState]
    RAY_STATE_UNKNOWN: _ClassVar[RayState]

class NumberFormat(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    NUMBER_FORMAT_UNSPECIFIED: _ClassVar[NumberFormat]
    NUMBER_FORMAT_F32: _ClassVar[NumberFormat]
    NUMBER_FORMAT_F16: _ClassVar[NumberFormat]
RAY_STATE_UNSPECIFIED: RayState
RAY_STATE_FREE: RayState
RAY_STATE_HIT: RayState
RAY_STATE_UNKNOWN: RayState
NUMBER_FORMAT_UNSPECIFIED: NumberFormat
NUMBER_FORMAT_F32: NumberFormat
NUMBER_FORMAT_F16: NumberFormat

class QuerySpheresRequest(_message.Message):
    __slots__ = ("map_id", "spheres_m", "fields", "min_epoch", "max_age_ms", "unknown_policy", "unknown_distance_m", "frame_id")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    SPHERES_M_FIELD_NUMBER: _ClassVar[int]
    FIELDS_FIELD_NUMBER: _ClassVar[int]
    MIN_EPOCH_FIELD_NUMBER: _ClassVar[int]
    MAX_AGE_MS_FIELD_NUMBER: _ClassVar[int]
    UNKNOWN_POLICY_FIELD_NUMBER: _ClassVar[int]
    UNKNOWN_DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    FRAME_ID_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    spheres_m: _containers.RepeatedScalarFieldContainer[float]
    fields: _containers.RepeatedScalarFieldContainer[_query_pb2.PointField]
    min_epoch: int
    max_age_ms: int
    unknown_policy: _query_pb2.UnknownPolicy
    unknown_distance_m: float
    frame_id: str
    def __init__(self, map_id: _Optional[str] = ..., spheres_m: _Optional[_Iterable[float]] = ..., fields: _Optional[_Iterable[_Union[_query_pb2.PointField, str]]] = ..., min_epoch: _Optional[int] = ..., max_age_ms: _Optional[int] = ..., unknown_policy: _Optional[_Union[_query_pb2.UnknownPolicy, str]] = ..., unknown_distance_m: _Optional[float] = ..., frame_id: _Optional[str] = ...) -> None: ...

class QuerySpheresReply(_message.Message):
    __slots__ = ("clearance_m", "gradient", "occupancy", "state", "epoch", "newest_stamp_ns", "server_us", "color")
    CLEARANCE_M_FIELD_NUMBER: _ClassVar[int]
    GRADIENT_FIELD_NUMBER: _ClassVar[int]
    OCCUPANCY_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    NEWEST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    SERVER_US_FIELD_NUMBER: _ClassVar[int]
    COLOR_FIELD_NUMBER: _ClassVar[int]
    clearance_m: _containers.RepeatedScalarFieldContainer[float]
    gradient: _containers.RepeatedScalarFieldContainer[float]
    occupancy: _containers.RepeatedScalarFieldContainer[float]
    state: bytes
    epoch: int
    newest_stamp_ns: int
    server_us: int
    color: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, clearance_m: _Optional[_Iterable[float]] = ..., gradient: _Optional[_Iterable[float]] = ..., occupancy: _Optional[_Iterable[float]] = ..., state: _Optional[bytes] = ..., epoch: _Optional[int] = ..., newest_stamp_ns: _Optional[int] = ..., server_us: _Optional[int] = ..., color: _Optional[_Iterable[float]] = ...) -> None: ...

class CheckTrajectoriesRequest(_message.Message):
    __slots__ = ("map_id", "spheres_m", "poses", "lengths", "margin_m", "swept", "min_epoch", "max_age_ms", "unknown_policy", "unknown_distance_m", "frame_id")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    SPHERES_M_FIELD_NUMBER: _ClassVar[int]
    POSES_FIELD_NUMBER: _ClassVar[int]
    LENGTHS_FIELD_NUMBER: _ClassVar[int]
    MARGIN_M_FIELD_NUMBER: _ClassVar[int]
    SWEPT_FIELD_NUMBER: _ClassVar[int]
    MIN_EPOCH_FIELD_NUMBER: _ClassVar[int]
    MAX_AGE_MS_FIELD_NUMBER: _ClassVar[int]
    UNKNOWN_POLICY_FIELD_NUMBER: _ClassVar[int]
    UNKNOWN_DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    FRAME_ID_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    spheres_m: _containers.RepeatedScalarFieldContainer[float]
    poses: _containers.RepeatedScalarFieldContainer[float]
    lengths: _containers.RepeatedScalarFieldContainer[int]
    margin_m: float
    swept: bool
    min_epoch: int
    max_age_ms: int
    unknown_policy: _query_pb2.UnknownPolicy
    unknown_distance_m: float
    frame_id: str
    def __init__(self, map_id: _Optional[str] = ..., spheres_m: _Optional[_Iterable[float]] = ..., poses: _Optional[_Iterable[float]] = ..., lengths: _Optional[_Iterable[int]] = ..., margin_m: _Optional[float] = ..., swept: bool = ..., min_epoch: _Optional[int] = ..., max_age_ms: _Optional[int] = ..., unknown_policy: _Optional[_Union[_query_pb2.UnknownPolicy, str]] = ..., unknown_distance_m: _Optional[float] = ..., frame_id: _Optional[str] = ...) -> None: ...

class CheckTrajectoriesReply(_message.Message):
    __slots__ = ("trajectories", "epoch", "newest_stamp_ns", "server_us")
    TRAJECTORIES_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    NEWEST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    SERVER_US_FIELD_NUMBER: _ClassVar[int]
    trajectories: _containers.RepeatedCompositeFieldContainer[TrajectoryVerdict]
    epoch: int
    newest_stamp_ns: int
    server_us: int
    def __init__(self, trajectories: _Optional[_Iterable[_Union[TrajectoryVerdict, _Mapping]]] = ..., epoch: _Optional[int] = ..., newest_stamp_ns: _Optional[int] = ..., server_us: _Optional[int] = ...) -> None: ...

class TrajectoryVerdict(_message.Message):
    __slots__ = ("min_clearance_m", "min_at", "first_hit", "unknown_hits")
    MIN_CLEARANCE_M_FIELD_NUMBER: _ClassVar[int]
    MIN_AT_FIELD_NUMBER: _ClassVar[int]
    FIRST_HIT_FIELD_NUMBER: _ClassVar[int]
    UNKNOWN_HITS_FIELD_NUMBER: _ClassVar[int]
    min_clearance_m: float
    min_at: TrajectoryPlace
    first_hit: TrajectoryPlace
    unknown_hits: int
    def __init__(self, min_clearance_m: _Optional[float] = ..., min_at: _Optional[_Union[TrajectoryPlace, _Mapping]] = ..., first_hit: _Optional[_Union[TrajectoryPlace, _Mapping]] = ..., unknown_hits: _Optional[int] = ...) -> None: ...

class TrajectoryPlace(_message.Message):
    __slots__ = ("pose", "fraction", "sphere")
    POSE_FIELD_NUMBER: _ClassVar[int]
    FRACTION_FIELD_NUMBER: _ClassVar[int]
    SPHERE_FIELD_NUMBER: _ClassVar[int]
    pose: int
    fraction: float
    sphere: int
    def __init__(self, pose: _Optional[int] = ..., fraction: _Optional[float] = ..., sphere: _Optional[int] = ...) -> None: ...

class CastRaysRequest(_message.Message):
    __slots__ = ("map_id", "origins_m", "directions", "max_range_m", "min_epoch", "max_age_ms", "unknown_policy", "frame_id")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    ORIGINS_M_FIELD_NUMBER: _ClassVar[int]
    DIRECTIONS_FIELD_NUMBER: _ClassVar[int]
    MAX_RANGE_M_FIELD_NUMBER: _ClassVar[int]
    MIN_EPOCH_FIELD_NUMBER: _ClassVar[int]
    MAX_AGE_MS_FIELD_NUMBER: _ClassVar[int]
    UNKNOWN_POLICY_FIELD_NUMBER: _ClassVar[int]
    FRAME_ID_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    origins_m: _containers.RepeatedScalarFieldContainer[float]
    directions: _containers.RepeatedScalarFieldContainer[float]
    max_range_m: float
    min_epoch: int
    max_age_ms: int
    unknown_policy: _query_pb2.UnknownPolicy
    frame_id: str
    def __init__(self, map_id: _Optional[str] = ..., origins_m: _Optional[_Iterable[float]] = ..., directions: _Optional[_Iterable[float]] = ..., max_range_m: _Optional[float] = ..., min_epoch: _Optional[int] = ..., max_age_ms: _Optional[int] = ..., unknown_policy: _Optional[_Union[_query_pb2.UnknownPolicy, str]] = ..., frame_id: _Optional[str] = ...) -> None: ...

class CastRaysReply(_message.Message):
    __slots__ = ("state", "distance_m", "normal", "unknown_at_m", "epoch", "newest_stamp_ns", "server_us")
    STATE_FIELD_NUMBER: _ClassVar[int]
    DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    NORMAL_FIELD_NUMBER: _ClassVar[int]
    UNKNOWN_AT_M_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    NEWEST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    SERVER_US_FIELD_NUMBER: _ClassVar[int]
    state: bytes
    distance_m: _containers.RepeatedScalarFieldContainer[float]
    normal: _containers.RepeatedScalarFieldContainer[float]
    unknown_at_m: _containers.RepeatedScalarFieldContainer[float]
    epoch: int
    newest_stamp_ns: int
    server_us: int
    def __init__(self, state: _Optional[bytes] = ..., distance_m: _Optional[_Iterable[float]] = ..., normal: _Optional[_Iterable[float]] = ..., unknown_at_m: _Optional[_Iterable[float]] = ..., epoch: _Optional[int] = ..., newest_stamp_ns: _Optional[int] = ..., server_us: _Optional[int] = ...) -> None: ...

class GetGridRequest(_message.Message):
    __slots__ = ("map_id", "region", "voxel_m", "fields", "format", "min_epoch", "max_age_ms", "unknown_policy", "unknown_distance_m", "frame_id")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    REGION_FIELD_NUMBER: _ClassVar[int]
    VOXEL_M_FIELD_NUMBER: _ClassVar[int]
    FIELDS_FIELD_NUMBER: _ClassVar[int]
    FORMAT_FIELD_NUMBER: _ClassVar[int]
    MIN_EPOCH_FIELD_NUMBER: _ClassVar[int]
    MAX_AGE_MS_FIELD_NUMBER: _ClassVar[int]
    UNKNOWN_POLICY_FIELD_NUMBER: _ClassVar[int]
    UNKNOWN_DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    FRAME_ID_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    region: _geometry_pb2.Aabb
    voxel_m: float
    fields: _containers.RepeatedScalarFieldContainer[_query_pb2.PointField]
    format: NumberFormat
    min_epoch: int
    max_age_ms: int
    unknown_policy: _query_pb2.UnknownPolicy
    unknown_distance_m: float
    frame_id: str
    def __init__(self, map_id: _Optional[str] = ..., region: _Optional[_Union[_geometry_pb2.Aabb, _Mapping]] = ..., voxel_m: _Optional[float] = ..., fields: _Optional[_Iterable[_Union[_query_pb2.PointField, str]]] = ..., format: _Optional[_Union[NumberFormat, str]] = ..., min_epoch: _Optional[int] = ..., max_age_ms: _Optional[int] = ..., unknown_policy: _Optional[_Union[_query_pb2.UnknownPolicy, str]] = ..., unknown_distance_m: _Optional[float] = ..., frame_id: _Optional[str] = ...) -> None: ...

class GetGridReply(_message.Message):
    __slots__ = ("origin_m", "voxel_m", "size", "stride", "columns", "epoch", "newest_stamp_ns", "server_us")
    ORIGIN_M_FIELD_NUMBER: _ClassVar[int]
    VOXEL_M_FIELD_NUMBER: _ClassVar[int]
    SIZE_FIELD_NUMBER: _ClassVar[int]
    STRIDE_FIELD_NUMBER: _ClassVar[int]
    COLUMNS_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    NEWEST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    SERVER_US_FIELD_NUMBER: _ClassVar[int]
    origin_m: _geometry_pb2.Vector3
    voxel_m: float
    size: _containers.RepeatedScalarFieldContainer[int]
    stride: _containers.RepeatedScalarFieldContainer[int]
    columns: _containers.RepeatedCompositeFieldContainer[GridColumn]
    epoch: int
    newest_stamp_ns: int
    server_us: int
    def __init__(self, origin_m: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., voxel_m: _Optional[float] = ..., size: _Optional[_Iterable[int]] = ..., stride: _Optional[_Iterable[int]] = ..., columns: _Optional[_Iterable[_Union[GridColumn, _Mapping]]] = ..., epoch: _Optional[int] = ..., newest_stamp_ns: _Optional[int] = ..., server_us: _Optional[int] = ...) -> None: ...

class GridColumn(_message.Message):
    __slots__ = ("field", "format", "width", "data")
    FIELD_FIELD_NUMBER: _ClassVar[int]
    FORMAT_FIELD_NUMBER: _ClassVar[int]
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    field: _query_pb2.PointField
    format: NumberFormat
    width: int
    data: bytes
    def __init__(self, field: _Optional[_Union[_query_pb2.PointField, str]] = ..., format: _Optional[_Union[NumberFormat, str]] = ..., width: _Optional[int] = ..., data: _Optional[bytes] = ...) -> None: ...

class GetSliceRequest(_message.Message):
    __slots__ = ("map_id", "z_m", "z_max_m", "resolution_m", "region", "costs", "min_epoch", "max_age_ms", "unknown_policy", "unknown_distance_m", "frame_id")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    Z_M_FIELD_NUMBER: _ClassVar[int]
    Z_MAX_M_FIELD_NUMBER: _ClassVar[int]
    RESOLUTION_M_FIELD_NUMBER: _ClassVar[int]
    REGION_FIELD_NUMBER: _ClassVar[int]
    COSTS_FIELD_NUMBER: _ClassVar[int]
    MIN_EPOCH_FIELD_NUMBER: _ClassVar[int]
    MAX_AGE_MS_FIELD_NUMBER: _ClassVar[int]
    UNKNOWN_POLICY_FIELD_NUMBER: _ClassVar[int]
    UNKNOWN_DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    FRAME_ID_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    z_m: float
    z_max_m: float
    resolution_m: float
    region: _geometry_pb2.Aabb
    costs: SliceCosts
    min_epoch: int
    max_age_ms: int
    unknown_policy: _query_pb2.UnknownPolicy
    unknown_distance_m: float
    frame_id: str
    def __init__(self, map_id: _Optional[str] = ..., z_m: _Optional[float] = ..., z_max_m: _Optional[float] = ..., resolution_m: _Optional[float] = ..., region: _Optional[_Union[_geometry_pb2.Aabb, _Mapping]] = ..., costs: _Optional[_Union[SliceCosts, _Mapping]] = ..., min_epoch: _Optional[int] = ..., max_age_ms: _Optional[int] = ..., unknown_policy: _Optional[_Union[_query_pb2.UnknownPolicy, str]] = ..., unknown_distance_m: _Optional[float] = ..., frame_id: _Optional[str] = ...) -> None: ...

class SliceCosts(_message.Message):
    __slots__ = ("robot_radius_m", "inflation_m")
    ROBOT_RADIUS_M_FIELD_NUMBER: _ClassVar[int]
    INFLATION_M_FIELD_NUMBER: _ClassVar[int]
    robot_radius_m: float
    inflation_m: float
    def __init__(self, robot_radius_m: _Optional[float] = ..., inflation_m: _Optional[float] = ...) -> None: ...

class GetSliceReply(_message.Message):
    __slots__ = ("origin_m", "resolution_m", "width", "height", "distance_m", "cost", "epoch", "newest_stamp_ns", "server_us")
    ORIGIN_M_FIELD_NUMBER: _ClassVar[int]
    RESOLUTION_M_FIELD_NUMBER: _ClassVar[int]
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    COST_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    NEWEST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    SERVER_US_FIELD_NUMBER: _ClassVar[int]
    origin_m: _geometry_pb2.Vector3
    resolution_m: float
    width: int
    height: int
    distance_m: _containers.RepeatedScalarFieldContainer[float]
    cost: bytes
    epoch: int
    newest_stamp_ns: int
    server_us: int
    def __init__(self, origin_m: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., resolution_m: _Optional[float] = ..., width: _Optional[int] = ..., height: _Optional[int] = ..., distance_m: _Optional[_Iterable[float]] = ..., cost: _Optional[bytes] = ..., epoch: _Optional[int] = ..., newest_stamp_ns: _Optional[int] = ..., server_us: _Optional[int] = ...) -> None: ...

class FindNearestRequest(_message.Message):
    __slots__ = ("map_id", "points_m", "max_unknown_m", "min_epoch", "max_age_ms", "frame_id")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    POINTS_M_FIELD_NUMBER: _ClassVar[int]
    MAX_UNKNOWN_M_FIELD_NUMBER: _ClassVar[int]
    MIN_EPOCH_FIELD_NUMBER: _ClassVar[int]
    MAX_AGE_MS_FIELD_NUMBER: _ClassVar[int]
    FRAME_ID_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    points_m: _containers.RepeatedScalarFieldContainer[float]
    max_unknown_m: float
    min_epoch: int
    max_age_ms: int
    frame_id: str
    def __init__(self, map_id: _Optional[str] = ..., points_m: _Optional[_Iterable[float]] = ..., max_unknown_m: _Optional[float] = ..., min_epoch: _Optional[int] = ..., max_age_ms: _Optional[int] = ..., frame_id: _Optional[str] = ...) -> None: ...

class FindNearestReply(_message.Message):
    __slots__ = ("surface_m", "distance_m", "state", "unknown_distance_m", "epoch", "newest_stamp_ns", "server_us")
    SURFACE_M_FIELD_NUMBER: _ClassVar[int]
    DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    UNKNOWN_DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    NEWEST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    SERVER_US_FIELD_NUMBER: _ClassVar[int]
    surface_m: _containers.RepeatedScalarFieldContainer[float]
    distance_m: _containers.RepeatedScalarFieldContainer[float]
    state: bytes
    unknown_distance_m: _containers.RepeatedScalarFieldContainer[float]
    epoch: int
    newest_stamp_ns: int
    server_us: int
    def __init__(self, surface_m: _Optional[_Iterable[float]] = ..., distance_m: _Optional[_Iterable[float]] = ..., state: _Optional[bytes] = ..., unknown_distance_m: _Optional[_Iterable[float]] = ..., epoch: _Optional[int] = ..., newest_stamp_ns: _Optional[int] = ..., server_us: _Optional[int] = ...) -> None: ...

class WatchRegionRequest(_message.Message):
    __slots__ = ("map_id", "region", "voxel_m", "min_interval_ms", "tolerance_m", "frame_id")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    REGION_FIELD_NUMBER: _ClassVar[int]
    VOXEL_M_FIELD_NUMBER: _ClassVar[int]
    MIN_INTERVAL_MS_FIELD_NUMBER: _ClassVar[int]
    TOLERANCE_M_FIELD_NUMBER: _ClassVar[int]
    FRAME_ID_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    region: _geometry_pb2.Aabb
    voxel_m: float
    min_interval_ms: int
    tolerance_m: float
    frame_id: str
    def __init__(self, map_id: _Optional[str] = ..., region: _Optional[_Union[_geometry_pb2.Aabb, _Mapping]] = ..., voxel_m: _Optional[float] = ..., min_interval_ms: _Optional[int] = ..., tolerance_m: _Optional[float] = ..., frame_id: _Optional[str] = ...) -> None: ...

class WatchRegionReply(_message.Message):
    __slots__ = ("origin_m", "voxel_m", "size", "bricks", "epoch", "newest_stamp_ns", "seq")
    ORIGIN_M_FIELD_NUMBER: _ClassVar[int]
    VOXEL_M_FIELD_NUMBER: _ClassVar[int]
    SIZE_FIELD_NUMBER: _ClassVar[int]
    BRICKS_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    NEWEST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    SEQ_FIELD_NUMBER: _ClassVar[int]
    origin_m: _geometry_pb2.Vector3
    voxel_m: float
    size: _containers.RepeatedScalarFieldContainer[int]
    bricks: _containers.RepeatedCompositeFieldContainer[RegionBrick]
    epoch: int
    newest_stamp_ns: int
    seq: int
    def __init__(self, origin_m: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., voxel_m: _Optional[float] = ..., size: _Optional[_Iterable[int]] = ..., bricks: _Optional[_Iterable[_Union[RegionBrick, _Mapping]]] = ..., epoch: _Optional[int] = ..., newest_stamp_ns: _Optional[int] = ..., seq: _Optional[int] = ...) -> None: ...

class RegionBrick(_message.Message):
    __slots__ = ("x", "y", "z", "distance_m", "state")
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    Z_FIELD_NUMBER: _ClassVar[int]
    DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    x: int
    y: int
    z: int
    distance_m: _containers.RepeatedScalarFieldContainer[float]
    state: bytes
    def __init__(self, x: _Optional[int] = ..., y: _Optional[int] = ..., z: _Optional[int] = ..., distance_m: _Optional[_Iterable[float]] = ..., state: _Optional[bytes] = ...) -> None: ...

class WatchTrajectoryRequest(_message.Message):
    __slots__ = ("check", "drop_m")
    CHECK_FIELD_NUMBER: _ClassVar[int]
    DROP_M_FIELD_NUMBER: _ClassVar[int]
    check: CheckTrajectoriesRequest
    drop_m: float
    def __init__(self, check: _Optional[_Union[CheckTrajectoriesRequest, _Mapping]] = ..., drop_m: _Optional[float] = ...) -> None: ...

class WatchTrajectoryReply(_message.Message):
    __slots__ = ("result", "seq")
    RESULT_FIELD_NUMBER: _ClassVar[int]
    SEQ_FIELD_NUMBER: _ClassVar[int]
    result: CheckTrajectoriesReply
    seq: int
    def __init__(self, result: _Optional[_Union[CheckTrajectoriesReply, _Mapping]] = ..., seq: _Optional[int] = ...) -> None: ...

class WatchReply(_message.Message):
    __slots__ = ("id", "key")
    ID_FIELD_NUMBER: _ClassVar[int]
    KEY_FIELD_NUMBER: _ClassVar[int]
    id: str
    key: str
    def __init__(self, id: _Optional[str] = ..., key: _Optional[str] = ...) -> None: ...
