from orenx.v1 import geometry_pb2 as _geometry_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Text(_message.Message):
    __slots__ = ("prompts", "negatives", "no_negatives", "encoder_id", "prompt_embeddings", "negative_embeddings")
    PROMPTS_FIELD_NUMBER: _ClassVar[int]
    NEGATIVES_FIELD_NUMBER: _ClassVar[int]
    NO_NEGATIVES_FIELD_NUMBER: _ClassVar[int]
    ENCODER_ID_FIELD_NUMBER: _ClassVar[int]
    PROMPT_EMBEDDINGS_FIELD_NUMBER: _ClassVar[int]
    NEGATIVE_EMBEDDINGS_FIELD_NUMBER: _ClassVar[int]
    prompts: _containers.RepeatedScalarFieldContainer[str]
    negatives: _containers.RepeatedScalarFieldContainer[str]
    no_negatives: bool
    encoder_id: str
    prompt_embeddings: _containers.RepeatedCompositeFieldContainer[Embedding]
    negative_embeddings: _containers.RepeatedCompositeFieldContainer[Embedding]
    def __init__(self, prompts: _Optional[_Iterable[str]] = ..., negatives: _Optional[_Iterable[str]] = ..., no_negatives: bool = ..., encoder_id: _Optional[str] = ..., prompt_embeddings: _Optional[_Iterable[_Union[Embedding, _Mapping]]] = ..., negative_embeddings: _Optional[_Iterable[_Union[Embedding, _Mapping]]] = ...) -> None: ...

class Embedding(_message.Message):
    __slots__ = ("values",)
    VALUES_FIELD_NUMBER: _ClassVar[int]
    values: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, values: _Optional[_Iterable[float]] = ...) -> None: ...

class QueryTextRequest(_message.Message):
    __slots__ = ("map_id", "prompts", "negatives", "no_negatives", "region", "min_score", "top_k", "min_epoch", "max_age_ms", "places")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    PROMPTS_FIELD_NUMBER: _ClassVar[int]
    NEGATIVES_FIELD_NUMBER: _ClassVar[int]
    NO_NEGATIVES_FIELD_NUMBER: _ClassVar[int]
    REGION_FIELD_NUMBER: _ClassVar[int]
    MIN_SCORE_FIELD_NUMBER: _ClassVar[int]
    TOP_K_FIELD_NUMBER: _ClassVar[int]
    MIN_EPOCH_FIELD_NUMBER: _ClassVar[int]
    MAX_AGE_MS_FIELD_NUMBER: _ClassVar[int]
    PLACES_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    prompts: _containers.RepeatedScalarFieldContainer[str]
    negatives: _containers.RepeatedScalarFieldContainer[str]
    no_negatives: bool
    region: _geometry_pb2.Aabb
    min_score: float
    top_k: int
    min_epoch: int
    max_age_ms: int
    places: bool
    def __init__(self, map_id: _Optional[str] = ..., prompts: _Optional[_Iterable[str]] = ..., negatives: _Optional[_Iterable[str]] = ..., no_negatives: bool = ..., region: _Optional[_Union[_geometry_pb2.Aabb, _Mapping]] = ..., min_score: _Optional[float] = ..., top_k: _Optional[int] = ..., min_epoch: _Optional[int] = ..., max_age_ms: _Optional[int] = ..., places: bool = ...) -> None: ...

class QueryEmbeddingRequest(_message.Message):
    __slots__ = ("map_id", "encoder_id", "prompts", "negatives", "region", "min_score", "top_k", "min_epoch", "max_age_ms", "places")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    ENCODER_ID_FIELD_NUMBER: _ClassVar[int]
    PROMPTS_FIELD_NUMBER: _ClassVar[int]
    NEGATIVES_FIELD_NUMBER: _ClassVar[int]
    REGION_FIELD_NUMBER: _ClassVar[int]
    MIN_SCORE_FIELD_NUMBER: _ClassVar[int]
    TOP_K_FIELD_NUMBER: _ClassVar[int]
    MIN_EPOCH_FIELD_NUMBER: _ClassVar[int]
    MAX_AGE_MS_FIELD_NUMBER: _ClassVar[int]
    PLACES_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    encoder_id: str
    prompts: _containers.RepeatedCompositeFieldContainer[Embedding]
    negatives: _containers.RepeatedCompositeFieldContainer[Embedding]
    region: _geometry_pb2.Aabb
    min_score: float
    top_k: int
    min_epoch: int
    max_age_ms: int
    places: bool
    def __init__(self, map_id: _Optional[str] = ..., encoder_id: _Optional[str] = ..., prompts: _Optional[_Iterable[_Union[Embedding, _Mapping]]] = ..., negatives: _Optional[_Iterable[_Union[Embedding, _Mapping]]] = ..., region: _Optional[_Union[_geometry_pb2.Aabb, _Mapping]] = ..., min_score: _Optional[float] = ..., top_k: _Optional[int] = ..., min_epoch: _Optional[int] = ..., max_age_ms: _Optional[int] = ..., places: bool = ...) -> None: ...

class QueryTextReply(_message.Message):
    __slots__ = ("matches", "encoder_id", "epoch", "newest_stamp_ns", "server_us", "places_m", "place_score")
    MATCHES_FIELD_NUMBER: _ClassVar[int]
    ENCODER_ID_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    NEWEST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    SERVER_US_FIELD_NUMBER: _ClassVar[int]
    PLACES_M_FIELD_NUMBER: _ClassVar[int]
    PLACE_SCORE_FIELD_NUMBER: _ClassVar[int]
    matches: _containers.RepeatedCompositeFieldContainer[Match]
    encoder_id: str
    epoch: int
    newest_stamp_ns: int
    server_us: int
    places_m: _containers.RepeatedScalarFieldContainer[float]
    place_score: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, matches: _Optional[_Iterable[_Union[Match, _Mapping]]] = ..., encoder_id: _Optional[str] = ..., epoch: _Optional[int] = ..., newest_stamp_ns: _Optional[int] = ..., server_us: _Optional[int] = ..., places_m: _Optional[_Iterable[float]] = ..., place_score: _Optional[_Iterable[float]] = ...) -> None: ...

class Match(_message.Message):
    __slots__ = ("id", "score", "centroid", "obb", "extent", "voxel_count", "best_view")
    ID_FIELD_NUMBER: _ClassVar[int]
    SCORE_FIELD_NUMBER: _ClassVar[int]
    CENTROID_FIELD_NUMBER: _ClassVar[int]
    OBB_FIELD_NUMBER: _ClassVar[int]
    EXTENT_FIELD_NUMBER: _ClassVar[int]
    VOXEL_COUNT_FIELD_NUMBER: _ClassVar[int]
    BEST_VIEW_FIELD_NUMBER: _ClassVar[int]
    id: int
    score: float
    centroid: _geometry_pb2.Vector3
    obb: OrientedBox
    extent: _geometry_pb2.Vector3
    voxel_count: int
    best_view: _geometry_pb2.Pose
    def __init__(self, id: _Optional[int] = ..., score: _Optional[float] = ..., centroid: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., obb: _Optional[_Union[OrientedBox, _Mapping]] = ..., extent: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., voxel_count: _Optional[int] = ..., best_view: _Optional[_Union[_geometry_pb2.Pose, _Mapping]] = ...) -> None: ...

class OrientedBox(_message.Message):
    __slots__ = ("center", "rotation", "half_size")
    CENTER_FIELD_NUMBER: _ClassVar[int]
    ROTATION_FIELD_NUMBER: _ClassVar[int]
    HALF_SIZE_FIELD_NUMBER: _ClassVar[int]
    center: _geometry_pb2.Vector3
    rotation: _geometry_pb2.Quaternion
    half_size: _geometry_pb2.Vector3
    def __init__(self, center: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., rotation: _Optional[_Union[_geometry_pb2.Quaternion, _Mapping]] = ..., half_size: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ...) -> None: ...

class ClassifyRequest(_message.Message):
    __slots__ = ("map_id", "points_m", "classes", "encoder_id", "class_embeddings", "min_epoch", "max_age_ms")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    POINTS_M_FIELD_NUMBER: _ClassVar[int]
    CLASSES_FIELD_NUMBER: _ClassVar[int]
    ENCODER_ID_FIELD_NUMBER: _ClassVar[int]
    CLASS_EMBEDDINGS_FIELD_NUMBER: _ClassVar[int]
    MIN_EPOCH_FIELD_NUMBER: _ClassVar[int]
    MAX_AGE_MS_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    points_m: _containers.RepeatedScalarFieldContainer[float]
    classes: _containers.RepeatedScalarFieldContainer[str]
    encoder_id: str
    class_embeddings: _containers.RepeatedCompositeFieldContainer[Embedding]
    min_epoch: int
    max_age_ms: int
    def __init__(self, map_id: _Optional[str] = ..., points_m: _Optional[_Iterable[float]] = ..., classes: _Optional[_Iterable[str]] = ..., encoder_id: _Optional[str] = ..., class_embeddings: _Optional[_Iterable[_Union[Embedding, _Mapping]]] = ..., min_epoch: _Optional[int] = ..., max_age_ms: _Optional[int] = ...) -> None: ...

class ClassifyReply(_message.Message):
    __slots__ = ("score", "encoder_id", "epoch", "newest_stamp_ns", "server_us")
    CLASS_FIELD_NUMBER: _ClassVar[int]
    SCORE_FIELD_NUMBER: _ClassVar[int]
    ENCODER_ID_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    NEWEST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    SERVER_US_FIELD_NUMBER: _ClassVar[int]
    score: _containers.RepeatedScalarFieldContainer[float]
    encoder_id: str
    epoch: int
    newest_stamp_ns: int
    server_us: int
    def __init__(self, score: _Optional[_Iterable[float]] = ..., encoder_id: _Optional[str] = ..., epoch: _Optional[int] = ..., newest_stamp_ns: _Optional[int] = ..., server_us: _Optional[int] = ..., **kwargs) -> None: ...

class ListEncodersRequest(_message.Message):
    __slots__ = ("map_id",)
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    def __init__(self, map_id: _Optional[str] = ...) -> None: ...

class ListEncodersReply(_message.Message):
    __slots__ = ("server", "map", "epoch", "newest_stamp_ns", "server_us")
    SERVER_FIELD_NUMBER: _ClassVar[int]
    MAP_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    NEWEST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    SERVER_US_FIELD_NUMBER: _ClassVar[int]
    server: Encoder
    map: Encoder
    epoch: int
    newest_stamp_ns: int
    server_us: int
    def __init__(self, server: _Optional[_Union[Encoder, _Mapping]] = ..., map: _Optional[_Union[Encoder, _Mapping]] = ..., epoch: _Optional[int] = ..., newest_stamp_ns: _Optional[int] = ..., server_us: _Optional[int] = ...) -> None: ...

class Encoder(_message.Message):
    __slots__ = ("encoder_id", "dimension")
    ENCODER_ID_FIELD_NUMBER: _ClassVar[int]
    DIMENSION_FIELD_NUMBER: _ClassVar[int]
    encoder_id: str
    dimension: int
    def __init__(self, encoder_id: _Optional[str] = ..., dimension: _Optional[int] = ...) -> None: ...
