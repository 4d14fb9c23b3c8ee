from orenx.v1 import language_pb2 as _language_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class UnknownPolicy(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    UNKNOWN_POLICY_REPORT: _ClassVar[UnknownPolicy]
    UNKNOWN_POLICY_FREE: _ClassVar[UnknownPolicy]
    UNKNOWN_POLICY_OCCUPIED: _ClassVar[UnknownPolicy]

class PointField(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    POINT_FIELD_UNSPECIFIED: _ClassVar[PointField]
    POINT_FIELD_DISTANCE: _ClassVar[PointField]
    POINT_FIELD_GRADIENT: _ClassVar[PointField]
    POINT_FIELD_OCCUPANCY: _ClassVar[PointField]
    POINT_FIELD_STATE: _ClassVar[PointField]
    POINT_FIELD_COLOR: _ClassVar[PointField]
    POINT_FIELD_TEXT_SCORE: _ClassVar[PointField]

class PointState(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    POINT_STATE_UNKNOWN: _ClassVar[PointState]
    POINT_STATE_FREE: _ClassVar[PointState]
    POINT_STATE_OCCUPIED: _ClassVar[PointState]
UNKNOWN_POLICY_REPORT: UnknownPolicy
UNKNOWN_POLICY_FREE: UnknownPolicy
UNKNOWN_POLICY_OCCUPIED: UnknownPolicy
POINT_FIELD_UNSPECIFIED: PointField
POINT_FIELD_DISTANCE: PointField
POINT_FIELD_GRADIENT: PointField
POINT_FIELD_OCCUPANCY: PointField
POINT_FIELD_STATE: PointField
POINT_FIELD_COLOR: PointField
POINT_FIELD_TEXT_SCORE: PointField
POINT_STATE_UNKNOWN: PointState
POINT_STATE_FREE: PointState
POINT_STATE_OCCUPIED: PointState

class QueryPointsRequest(_message.Message):
    __slots__ = ("map_id", "points_m", "fields", "min_epoch", "max_age_ms", "unknown_policy", "unknown_distance_m", "frame_id", "text")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    POINTS_M_FIELD_NUMBER: _ClassVar[int]
    FIELDS_FIELD_NUMBER: _ClassVar[int]
    MIN_EPOCH_FIELD_NUMBER: _ClassVar[int]
    MAX_AGE_MS_FIELD_NUMBER: _ClassVar[int]
    UNKNOWN_POLICY_FIELD_NUMBER: _ClassVar[int]
    UNKNOWN_DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    FRAME_ID_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    points_m: _containers.RepeatedScalarFieldContainer[float]
    fields: _containers.RepeatedScalarFieldContainer[PointField]
    min_epoch: int
    max_age_ms: int
    unknown_policy: UnknownPolicy
    unknown_distance_m: float
    frame_id: str
    text: _language_pb2.Text
    def __init__(self, map_id: _Optional[str] = ..., points_m: _Optional[_Iterable[float]] = ..., fields: _Optional[_Iterable[_Union[PointField, str]]] = ..., min_epoch: _Optional[int] = ..., max_age_ms: _Optional[int] = ..., unknown_policy: _Optional[_Union[UnknownPolicy, str]] = ..., unknown_distance_m: _Optional[float] = ..., frame_id: _Optional[str] = ..., text: _Optional[_Union[_language_pb2.Text, _Mapping]] = ...) -> None: ...

class QueryPointsReply(_message.Message):
    __slots__ = ("distance_m", "gradient", "occupancy", "state", "epoch", "newest_stamp_ns", "server_us", "color", "text_score")
    DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    GRADIENT_FIELD_NUMBER: _ClassVar[int]
    OCCUPANCY_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    NEWEST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    SERVER_US_FIELD_NUMBER: _ClassVar[int]
    COLOR_FIELD_NUMBER: _ClassVar[int]
    TEXT_SCORE_FIELD_NUMBER: _ClassVar[int]
    distance_m: _containers.RepeatedScalarFieldContainer[float]
    gradient: _containers.RepeatedScalarFieldContainer[float]
    occupancy: _containers.RepeatedScalarFieldContainer[float]
    state: bytes
    epoch: int
    newest_stamp_ns: int
    server_us: int
    color: _containers.RepeatedScalarFieldContainer[float]
    text_score: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, distance_m: _Optional[_Iterable[float]] = ..., gradient: _Optional[_Iterable[float]] = ..., occupancy: _Optional[_Iterable[float]] = ..., state: _Optional[bytes] = ..., epoch: _Optional[int] = ..., newest_stamp_ns: _Optional[int] = ..., server_us: _Optional[int] = ..., color: _Optional[_Iterable[float]] = ..., text_score: _Optional[_Iterable[float]] = ...) -> None: ...

class StreamQueryRequest(_message.Message):
    __slots__ = ("id", "points")
    ID_FIELD_NUMBER: _ClassVar[int]
    POINTS_FIELD_NUMBER: _ClassVar[int]
    id: int
    points: QueryPointsRequest
    def __init__(self, id: _Optional[int] = ..., points: _Optional[_Union[QueryPointsRequest, _Mapping]] = ...) -> None: ...

class StreamQueryReply(_message.Message):
    __slots__ = ("id", "points", "error")
    ID_FIELD_NUMBER: _ClassVar[int]
    POINTS_FIELD_NUMBER: _ClassVar[int]
    ERROR_FIELD_NUMBER: _ClassVar[int]
    id: int
    points: QueryPointsReply
    error: QueryError
    def __init__(self, id: _Optional[int] = ..., points: _Optional[_Union[QueryPointsReply, _Mapping]] = ..., error: _Optional[_Union[QueryError, _Mapping]] = ...) -> None: ...

class QueryError(_message.Message):
    __slots__ = ("code", "field", "message")
    CODE_FIELD_NUMBER: _ClassVar[int]
    FIELD_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    code: int
    field: str
    message: str
    def __init__(self, code: _Optional[int] = ..., field: _Optional[str] = ..., message: _Optional[str] = ...) -> None: ...
