from orenx.v1 import geometry_pb2 as _geometry_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class MirrorTable(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    MIRROR_TABLE_UNSPECIFIED: _ClassVar[MirrorTable]
    MIRROR_TABLE_NODES: _ClassVar[MirrorTable]
    MIRROR_TABLE_ROWS: _ClassVar[MirrorTable]
    MIRROR_TABLE_BRICKS: _ClassVar[MirrorTable]
    MIRROR_TABLE_COLORS: _ClassVar[MirrorTable]
    MIRROR_TABLE_CODES: _ClassVar[MirrorTable]
    MIRROR_TABLE_ATOMS: _ClassVar[MirrorTable]
    MIRROR_TABLE_DECODERS: _ClassVar[MirrorTable]
    MIRROR_TABLE_VIEWPOINTS: _ClassVar[MirrorTable]
MIRROR_TABLE_UNSPECIFIED: MirrorTable
MIRROR_TABLE_NODES: MirrorTable
MIRROR_TABLE_ROWS: MirrorTable
MIRROR_TABLE_BRICKS: MirrorTable
MIRROR_TABLE_COLORS: MirrorTable
MIRROR_TABLE_CODES: MirrorTable
MIRROR_TABLE_ATOMS: MirrorTable
MIRROR_TABLE_DECODERS: MirrorTable
MIRROR_TABLE_VIEWPOINTS: MirrorTable

class SubscribeRequest(_message.Message):
    __slots__ = ("map_id", "no_radiance", "no_language", "min_interval_ms")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    NO_RADIANCE_FIELD_NUMBER: _ClassVar[int]
    NO_LANGUAGE_FIELD_NUMBER: _ClassVar[int]
    MIN_INTERVAL_MS_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    no_radiance: bool
    no_language: bool
    min_interval_ms: int
    def __init__(self, map_id: _Optional[str] = ..., no_radiance: bool = ..., no_language: bool = ..., min_interval_ms: _Optional[int] = ...) -> None: ...

class MirrorMessage(_message.Message):
    __slots__ = ("head", "part", "end")
    HEAD_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    END_FIELD_NUMBER: _ClassVar[int]
    head: MirrorHead
    part: MirrorPart
    end: MirrorEnd
    def __init__(self, head: _Optional[_Union[MirrorHead, _Mapping]] = ..., part: _Optional[_Union[MirrorPart, _Mapping]] = ..., end: _Optional[_Union[MirrorEnd, _Mapping]] = ...) -> None: ...

class MirrorHead(_message.Message):
    __slots__ = ("from_epoch", "epoch", "newest_stamp_ns", "settings_json", "root", "bounds", "slots", "encoder_id", "dimension", "format")
    FROM_EPOCH_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    NEWEST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    SETTINGS_JSON_FIELD_NUMBER: _ClassVar[int]
    ROOT_FIELD_NUMBER: _ClassVar[int]
    BOUNDS_FIELD_NUMBER: _ClassVar[int]
    SLOTS_FIELD_NUMBER: _ClassVar[int]
    ENCODER_ID_FIELD_NUMBER: _ClassVar[int]
    DIMENSION_FIELD_NUMBER: _ClassVar[int]
    FORMAT_FIELD_NUMBER: _ClassVar[int]
    from_epoch: int
    epoch: int
    newest_stamp_ns: int
    settings_json: str
    root: MirrorRoot
    bounds: _geometry_pb2.Aabb
    slots: _containers.RepeatedScalarFieldContainer[int]
    encoder_id: str
    dimension: int
    format: int
    def __init__(self, from_epoch: _Optional[int] = ..., epoch: _Optional[int] = ..., newest_stamp_ns: _Optional[int] = ..., settings_json: _Optional[str] = ..., root: _Optional[_Union[MirrorRoot, _Mapping]] = ..., bounds: _Optional[_Union[_geometry_pb2.Aabb, _Mapping]] = ..., slots: _Optional[_Iterable[int]] = ..., encoder_id: _Optional[str] = ..., dimension: _Optional[int] = ..., format: _Optional[int] = ...) -> None: ...

class MirrorRoot(_message.Message):
    __slots__ = ("node", "min", "log2_size")
    NODE_FIELD_NUMBER: _ClassVar[int]
    MIN_FIELD_NUMBER: _ClassVar[int]
    LOG2_SIZE_FIELD_NUMBER: _ClassVar[int]
    node: int
    min: _containers.RepeatedScalarFieldContainer[int]
    log2_size: int
    def __init__(self, node: _Optional[int] = ..., min: _Optional[_Iterable[int]] = ..., log2_size: _Optional[int] = ...) -> None: ...

class MirrorPart(_message.Message):
    __slots__ = ("table", "slots", "data")
    TABLE_FIELD_NUMBER: _ClassVar[int]
    SLOTS_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    table: MirrorTable
    slots: _containers.RepeatedScalarFieldContainer[int]
    data: bytes
    def __init__(self, table: _Optional[_Union[MirrorTable, str]] = ..., slots: _Optional[_Iterable[int]] = ..., data: _Optional[bytes] = ...) -> None: ...

class MirrorEnd(_message.Message):
    __slots__ = ("epoch",)
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    epoch: int
    def __init__(self, epoch: _Optional[int] = ...) -> None: ...
