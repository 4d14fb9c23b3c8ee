from orenx.v1 import geometry_pb2 as _geometry_pb2
from orenx.v1 import language_pb2 as _language_pb2
from orenx.v1 import query_pb2 as _query_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class ImageOutput(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    IMAGE_OUTPUT_UNSPECIFIED: _ClassVar[ImageOutput]
    IMAGE_OUTPUT_COLOR: _ClassVar[ImageOutput]
    IMAGE_OUTPUT_DEPTH: _ClassVar[ImageOutput]
    IMAGE_OUTPUT_NORMAL: _ClassVar[ImageOutput]
    IMAGE_OUTPUT_OPACITY: _ClassVar[ImageOutput]
    IMAGE_OUTPUT_UNKNOWN: _ClassVar[ImageOutput]
    IMAGE_OUTPUT_HEAT: _ClassVar[ImageOutput]

class ImageEncoding(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    IMAGE_ENCODING_UNSPECIFIED: _ClassVar[ImageEncoding]
    IMAGE_ENCODING_PNG: _ClassVar[ImageEncoding]
    IMAGE_ENCODING_JPEG: _ClassVar[ImageEncoding]
    IMAGE_ENCODING_F32: _ClassVar[ImageEncoding]
    IMAGE_ENCODING_U8: _ClassVar[ImageEncoding]

class Renderer(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    RENDERER_UNSPECIFIED: _ClassVar[Renderer]
    RENDERER_TILE: _ClassVar[Renderer]
    RENDERER_RAY: _ClassVar[Renderer]
IMAGE_OUTPUT_UNSPECIFIED: ImageOutput
IMAGE_OUTPUT_COLOR: ImageOutput
IMAGE_OUTPUT_DEPTH: ImageOutput
IMAGE_OUTPUT_NORMAL: ImageOutput
IMAGE_OUTPUT_OPACITY: ImageOutput
IMAGE_OUTPUT_UNKNOWN: ImageOutput
IMAGE_OUTPUT_HEAT: ImageOutput
IMAGE_ENCODING_UNSPECIFIED: ImageEncoding
IMAGE_ENCODING_PNG: ImageEncoding
IMAGE_ENCODING_JPEG: ImageEncoding
IMAGE_ENCODING_F32: ImageEncoding
IMAGE_ENCODING_U8: ImageEncoding
RENDERER_UNSPECIFIED: Renderer
RENDERER_TILE: Renderer
RENDERER_RAY: Renderer

class RenderRequest(_message.Message):
    __slots__ = ("map_id", "world_from_camera", "intrinsics", "images", "renderer", "min_epoch", "max_age_ms", "text")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    WORLD_FROM_CAMERA_FIELD_NUMBER: _ClassVar[int]
    INTRINSICS_FIELD_NUMBER: _ClassVar[int]
    IMAGES_FIELD_NUMBER: _ClassVar[int]
    RENDERER_FIELD_NUMBER: _ClassVar[int]
    MIN_EPOCH_FIELD_NUMBER: _ClassVar[int]
    MAX_AGE_MS_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    world_from_camera: _geometry_pb2.Pose
    intrinsics: _geometry_pb2.Intrinsics
    images: _containers.RepeatedCompositeFieldContainer[ImageRequest]
    renderer: Renderer
    min_epoch: int
    max_age_ms: int
    text: _language_pb2.Text
    def __init__(self, map_id: _Optional[str] = ..., world_from_camera: _Optional[_Union[_geometry_pb2.Pose, _Mapping]] = ..., intrinsics: _Optional[_Union[_geometry_pb2.Intrinsics, _Mapping]] = ..., images: _Optional[_Iterable[_Union[ImageRequest, _Mapping]]] = ..., renderer: _Optional[_Union[Renderer, str]] = ..., min_epoch: _Optional[int] = ..., max_age_ms: _Optional[int] = ..., text: _Optional[_Union[_language_pb2.Text, _Mapping]] = ...) -> None: ...

class ImageRequest(_message.Message):
    __slots__ = ("output", "encoding", "jpeg_quality")
    OUTPUT_FIELD_NUMBER: _ClassVar[int]
    ENCODING_FIELD_NUMBER: _ClassVar[int]
    JPEG_QUALITY_FIELD_NUMBER: _ClassVar[int]
    output: ImageOutput
    encoding: ImageEncoding
    jpeg_quality: int
    def __init__(self, output: _Optional[_Union[ImageOutput, str]] = ..., encoding: _Optional[_Union[ImageEncoding, str]] = ..., jpeg_quality: _Optional[int] = ...) -> None: ...

class RenderReply(_message.Message):
    __slots__ = ("images", "width", "height", "epoch", "newest_stamp_ns", "server_us")
    IMAGES_FIELD_NUMBER: _ClassVar[int]
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    NEWEST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    SERVER_US_FIELD_NUMBER: _ClassVar[int]
    images: _containers.RepeatedCompositeFieldContainer[RenderedImage]
    width: int
    height: int
    epoch: int
    newest_stamp_ns: int
    server_us: int
    def __init__(self, images: _Optional[_Iterable[_Union[RenderedImage, _Mapping]]] = ..., width: _Optional[int] = ..., height: _Optional[int] = ..., epoch: _Optional[int] = ..., newest_stamp_ns: _Optional[int] = ..., server_us: _Optional[int] = ...) -> None: ...

class RenderedImage(_message.Message):
    __slots__ = ("output", "encoding", "data")
    OUTPUT_FIELD_NUMBER: _ClassVar[int]
    ENCODING_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    output: ImageOutput
    encoding: ImageEncoding
    data: bytes
    def __init__(self, output: _Optional[_Union[ImageOutput, str]] = ..., encoding: _Optional[_Union[ImageEncoding, str]] = ..., data: _Optional[bytes] = ...) -> None: ...

class RenderStreamRequest(_message.Message):
    __slots__ = ("id", "request")
    ID_FIELD_NUMBER: _ClassVar[int]
    REQUEST_FIELD_NUMBER: _ClassVar[int]
    id: int
    request: RenderRequest
    def __init__(self, id: _Optional[int] = ..., request: _Optional[_Union[RenderRequest, _Mapping]] = ...) -> None: ...

class RenderStreamReply(_message.Message):
    __slots__ = ("id", "reply", "error")
    ID_FIELD_NUMBER: _ClassVar[int]
    REPLY_FIELD_NUMBER: _ClassVar[int]
    ERROR_FIELD_NUMBER: _ClassVar[int]
    id: int
    reply: RenderReply
    error: _query_pb2.QueryError
    def __init__(self, id: _Optional[int] = ..., reply: _Optional[_Union[RenderReply, _Mapping]] = ..., error: _Optional[_Union[_query_pb2.QueryError, _Mapping]] = ...) -> None: ...
