from orenx.v1 import geometry_pb2 as _geometry_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class QueuePolicy(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    QUEUE_POLICY_LATEST: _ClassVar[QueuePolicy]
    QUEUE_POLICY_BLOCK: _ClassVar[QueuePolicy]

class DepthEncoding(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    DEPTH_ENCODING_UNSPECIFIED: _ClassVar[DepthEncoding]
    DEPTH_ENCODING_U16: _ClassVar[DepthEncoding]
    DEPTH_ENCODING_F32_METRES: _ClassVar[DepthEncoding]
    DEPTH_ENCODING_PNG16: _ClassVar[DepthEncoding]

class ColorEncoding(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    COLOR_ENCODING_UNSPECIFIED: _ClassVar[ColorEncoding]
    COLOR_ENCODING_RGB8: _ClassVar[ColorEncoding]
    COLOR_ENCODING_JPEG: _ClassVar[ColorEncoding]
    COLOR_ENCODING_PNG: _ClassVar[ColorEncoding]

class FeatureEncoding(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    FEATURE_ENCODING_UNSPECIFIED: _ClassVar[FeatureEncoding]
    FEATURE_ENCODING_F16: _ClassVar[FeatureEncoding]
    FEATURE_ENCODING_F32: _ClassVar[FeatureEncoding]

class LabelEncoding(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    LABEL_ENCODING_UNSPECIFIED: _ClassVar[LabelEncoding]
    LABEL_ENCODING_U8: _ClassVar[LabelEncoding]
    LABEL_ENCODING_U16: _ClassVar[LabelEncoding]
    LABEL_ENCODING_PNG: _ClassVar[LabelEncoding]

class FrameStatus(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    FRAME_STATUS_UNSPECIFIED: _ClassVar[FrameStatus]
    FRAME_STATUS_ACCEPTED: _ClassVar[FrameStatus]
    FRAME_STATUS_INTEGRATED: _ClassVar[FrameStatus]
    FRAME_STATUS_DROPPED: _ClassVar[FrameStatus]
    FRAME_STATUS_REJECTED: _ClassVar[FrameStatus]
    FRAME_STATUS_DURABLE: _ClassVar[FrameStatus]

class FrameReason(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    FRAME_REASON_UNSPECIFIED: _ClassVar[FrameReason]
    FRAME_REASON_REPLACED: _ClassVar[FrameReason]
    FRAME_REASON_STOPPING: _ClassVar[FrameReason]
    FRAME_REASON_INVALID_FIELD: _ClassVar[FrameReason]
    FRAME_REASON_UNKNOWN_MAP: _ClassVar[FrameReason]
    FRAME_REASON_EXHAUSTED: _ClassVar[FrameReason]
    FRAME_REASON_INTERNAL: _ClassVar[FrameReason]
    FRAME_REASON_ABANDONED: _ClassVar[FrameReason]
    FRAME_REASON_RESET: _ClassVar[FrameReason]
    FRAME_REASON_POSE_NOT_FINITE: _ClassVar[FrameReason]
    FRAME_REASON_POSE_NOT_RIGID: _ClassVar[FrameReason]
    FRAME_REASON_SIZE_MISMATCH: _ClassVar[FrameReason]
    FRAME_REASON_DEPTH_UNIT: _ClassVar[FrameReason]
    FRAME_REASON_INTRINSICS: _ClassVar[FrameReason]
    FRAME_REASON_TOO_OLD: _ClassVar[FrameReason]
    FRAME_REASON_OUT_OF_ORDER: _ClassVar[FrameReason]
    FRAME_REASON_ENCODER: _ClassVar[FrameReason]
QUEUE_POLICY_LATEST: QueuePolicy
QUEUE_POLICY_BLOCK: QueuePolicy
DEPTH_ENCODING_UNSPECIFIED: DepthEncoding
DEPTH_ENCODING_U16: DepthEncoding
DEPTH_ENCODING_F32_METRES: DepthEncoding
DEPTH_ENCODING_PNG16: DepthEncoding
COLOR_ENCODING_UNSPECIFIED: ColorEncoding
COLOR_ENCODING_RGB8: ColorEncoding
COLOR_ENCODING_JPEG: ColorEncoding
COLOR_ENCODING_PNG: ColorEncoding
FEATURE_ENCODING_UNSPECIFIED: FeatureEncoding
FEATURE_ENCODING_F16: FeatureEncoding
FEATURE_ENCODING_F32: FeatureEncoding
LABEL_ENCODING_UNSPECIFIED: LabelEncoding
LABEL_ENCODING_U8: LabelEncoding
LABEL_ENCODING_U16: LabelEncoding
LABEL_ENCODING_PNG: LabelEncoding
FRAME_STATUS_UNSPECIFIED: FrameStatus
FRAME_STATUS_ACCEPTED: FrameStatus
FRAME_STATUS_INTEGRATED: FrameStatus
FRAME_STATUS_DROPPED: FrameStatus
FRAME_STATUS_REJECTED: FrameStatus
FRAME_STATUS_DURABLE: FrameStatus
FRAME_REASON_UNSPECIFIED: FrameReason
FRAME_REASON_REPLACED: FrameReason
FRAME_REASON_STOPPING: FrameReason
FRAME_REASON_INVALID_FIELD: FrameReason
FRAME_REASON_UNKNOWN_MAP: FrameReason
FRAME_REASON_EXHAUSTED: FrameReason
FRAME_REASON_INTERNAL: FrameReason
FRAME_REASON_ABANDONED: FrameReason
FRAME_REASON_RESET: FrameReason
FRAME_REASON_POSE_NOT_FINITE: FrameReason
FRAME_REASON_POSE_NOT_RIGID: FrameReason
FRAME_REASON_SIZE_MISMATCH: FrameReason
FRAME_REASON_DEPTH_UNIT: FrameReason
FRAME_REASON_INTRINSICS: FrameReason
FRAME_REASON_TOO_OLD: FrameReason
FRAME_REASON_OUT_OF_ORDER: FrameReason
FRAME_REASON_ENCODER: FrameReason

class Frame(_message.Message):
    __slots__ = ("map_id", "robot_id", "sensor_id", "seq", "stamp_ns", "world_from_camera", "intrinsics", "depth", "color", "queue_policy", "features", "labels")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    ROBOT_ID_FIELD_NUMBER: _ClassVar[int]
    SENSOR_ID_FIELD_NUMBER: _ClassVar[int]
    SEQ_FIELD_NUMBER: _ClassVar[int]
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    WORLD_FROM_CAMERA_FIELD_NUMBER: _ClassVar[int]
    INTRINSICS_FIELD_NUMBER: _ClassVar[int]
    DEPTH_FIELD_NUMBER: _ClassVar[int]
    COLOR_FIELD_NUMBER: _ClassVar[int]
    QUEUE_POLICY_FIELD_NUMBER: _ClassVar[int]
    FEATURES_FIELD_NUMBER: _ClassVar[int]
    LABELS_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    robot_id: str
    sensor_id: str
    seq: int
    stamp_ns: int
    world_from_camera: _geometry_pb2.Pose
    intrinsics: _geometry_pb2.Intrinsics
    depth: DepthImage
    color: ColorImage
    queue_policy: QueuePolicy
    features: FeatureImage
    labels: LabelImage
    def __init__(self, map_id: _Optional[str] = ..., robot_id: _Optional[str] = ..., sensor_id: _Optional[str] = ..., seq: _Optional[int] = ..., stamp_ns: _Optional[int] = ..., world_from_camera: _Optional[_Union[_geometry_pb2.Pose, _Mapping]] = ..., intrinsics: _Optional[_Union[_geometry_pb2.Intrinsics, _Mapping]] = ..., depth: _Optional[_Union[DepthImage, _Mapping]] = ..., color: _Optional[_Union[ColorImage, _Mapping]] = ..., queue_policy: _Optional[_Union[QueuePolicy, str]] = ..., features: _Optional[_Union[FeatureImage, _Mapping]] = ..., labels: _Optional[_Union[LabelImage, _Mapping]] = ...) -> None: ...

class DepthImage(_message.Message):
    __slots__ = ("encoding", "units_per_metre", "data")
    ENCODING_FIELD_NUMBER: _ClassVar[int]
    UNITS_PER_METRE_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    encoding: DepthEncoding
    units_per_metre: float
    data: bytes
    def __init__(self, encoding: _Optional[_Union[DepthEncoding, str]] = ..., units_per_metre: _Optional[float] = ..., data: _Optional[bytes] = ...) -> None: ...

class ColorImage(_message.Message):
    __slots__ = ("encoding", "data")
    ENCODING_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    encoding: ColorEncoding
    data: bytes
    def __init__(self, encoding: _Optional[_Union[ColorEncoding, str]] = ..., data: _Optional[bytes] = ...) -> None: ...

class FeatureImage(_message.Message):
    __slots__ = ("encoder_id", "height", "width", "dimension", "encoding", "data", "index")
    ENCODER_ID_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    DIMENSION_FIELD_NUMBER: _ClassVar[int]
    ENCODING_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    INDEX_FIELD_NUMBER: _ClassVar[int]
    encoder_id: str
    height: int
    width: int
    dimension: int
    encoding: FeatureEncoding
    data: bytes
    index: bytes
    def __init__(self, encoder_id: _Optional[str] = ..., height: _Optional[int] = ..., width: _Optional[int] = ..., dimension: _Optional[int] = ..., encoding: _Optional[_Union[FeatureEncoding, str]] = ..., data: _Optional[bytes] = ..., index: _Optional[bytes] = ...) -> None: ...

class LabelImage(_message.Message):
    __slots__ = ("encoding", "data", "classes", "width", "height")
    ENCODING_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    CLASSES_FIELD_NUMBER: _ClassVar[int]
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    encoding: LabelEncoding
    data: bytes
    classes: _containers.RepeatedCompositeFieldContainer[LabelClass]
    width: int
    height: int
    def __init__(self, encoding: _Optional[_Union[LabelEncoding, str]] = ..., data: _Optional[bytes] = ..., classes: _Optional[_Iterable[_Union[LabelClass, _Mapping]]] = ..., width: _Optional[int] = ..., height: _Optional[int] = ...) -> None: ...

class LabelClass(_message.Message):
    __slots__ = ("id", "name")
    ID_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    id: int
    name: str
    def __init__(self, id: _Optional[int] = ..., name: _Optional[str] = ...) -> None: ...

class FrameAck(_message.Message):
    __slots__ = ("robot_id", "sensor_id", "seq", "status", "reason", "field", "message", "epoch", "newest_stamp_ns", "server_us", "queue_depth", "queue_capacity", "credit")
    ROBOT_ID_FIELD_NUMBER: _ClassVar[int]
    SENSOR_ID_FIELD_NUMBER: _ClassVar[int]
    SEQ_FIELD_NUMBER: _ClassVar[int]
    STATUS_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    FIELD_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    NEWEST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    SERVER_US_FIELD_NUMBER: _ClassVar[int]
    QUEUE_DEPTH_FIELD_NUMBER: _ClassVar[int]
    QUEUE_CAPACITY_FIELD_NUMBER: _ClassVar[int]
    CREDIT_FIELD_NUMBER: _ClassVar[int]
    robot_id: str
    sensor_id: str
    seq: int
    status: FrameStatus
    reason: FrameReason
    field: str
    message: str
    epoch: int
    newest_stamp_ns: int
    server_us: int
    queue_depth: int
    queue_capacity: int
    credit: int
    def __init__(self, robot_id: _Optional[str] = ..., sensor_id: _Optional[str] = ..., seq: _Optional[int] = ..., status: _Optional[_Union[FrameStatus, str]] = ..., reason: _Optional[_Union[FrameReason, str]] = ..., field: _Optional[str] = ..., message: _Optional[str] = ..., epoch: _Optional[int] = ..., newest_stamp_ns: _Optional[int] = ..., server_us: _Optional[int] = ..., queue_depth: _Optional[int] = ..., queue_capacity: _Optional[int] = ..., credit: _Optional[int] = ...) -> None: ...
