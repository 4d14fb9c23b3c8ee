"""Frames: numpy to messages, and what the server says of each."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InvalidArgumentError
from .geometry import Intrinsics, pose_to_wire
from .types import Bytes
from .v1 import ingest_pb2 as wire
from .verbs import enum_name

_PNG, _JPEG = b"\x89PNG", b"\xff\xd8"


@dataclass(eq=False)
class Labels:
    """The class of each pixel, by any segmenter. The server embeds the names with its text encoder."""

    # (H, W) integers, or the bytes of a grey PNG; 0 says nothing.
    ids: NDArray[Any] | Bytes
    # Names by id, 1 to 65535.
    classes: Mapping[int, str]


@dataclass(eq=False)
class Features:
    """Vision-language features: a grid of patches, or few features and which of them each pixel has."""

    encoder_id: str
    # (h, w, dimension) f16 or f32; (k, dimension) with an index.
    values: NDArray[Any]
    # (H, W): which of the features each pixel has, from 0; 65535: none.
    index: NDArray[Any] | None = None


@dataclass(eq=False)
class Frame:
    """One posed depth image.

    depth: (H, W) floats in metres, or integers (uint16) with `units_per_metre`, or the bytes of a 16-bit PNG;
    along the optical axis, 0 or NaN where there is none.
    pose: world_from_camera, 4x4 or x y z qx qy qz qw, optical axes (z forward, x right, y down).
    color: (H, W, 3) uint8 sRGB of the same pixels, or the bytes of a JPEG or PNG.
    """

    depth: NDArray[Any] | Bytes
    pose: ArrayLike
    intrinsics: Intrinsics
    color: NDArray[Any] | Bytes | None = None
    # Capture time, Unix ns; None: now.
    stamp_ns: int | None = None
    units_per_metre: float = 1000.0
    labels: Labels | None = None
    features: Features | None = None

    def to_wire(self, map_id: str, robot_id: str, sensor_id: str, policy: int) -> wire.Frame:
        """As a message, without a number."""
        if self.labels is not None and self.features is not None:
            raise InvalidArgumentError("labels: a frame has these or features", field="labels")
        return wire.Frame(
            map_id=map_id,
            robot_id=robot_id,
            sensor_id=sensor_id,
            stamp_ns=time.time_ns() if self.stamp_ns is None else int(self.stamp_ns),
            world_from_camera=pose_to_wire("pose", self.pose),
            intrinsics=self.intrinsics.to_wire(),
            depth=_depth(self.depth, self.intrinsics, self.units_per_metre),
            color=None if self.color is None else _color(self.color, self.intrinsics),
            queue_policy=policy,  # type: ignore[arg-type]
            features=None if self.features is None else _features(self.features),
            labels=None if self.labels is None else _labels(self.labels),
        )


def _is_bytes(image: Any) -> bool:
    return isinstance(image, (bytes, bytearray, memoryview))


def _sized(field: str, image: NDArray[Any], camera: Intrinsics, channels: int) -> NDArray[Any]:
    shape = (camera.height, camera.width, 3)[: 3 if channels == 3 else 2]
    if image.shape != shape:
        problem = f"{field}: shape {image.shape} is not {shape}, the size of the intrinsics"
        raise InvalidArgumentError(problem, field=field)
    return image


def _depth(depth: Any, camera: Intrinsics, units_per_metre: float) -> wire.DepthImage:
    if _is_bytes(depth):
        return wire.DepthImage(
            encoding=wire.DEPTH_ENCODING_PNG16, units_per_metre=units_per_metre, data=bytes(depth)
        )
    image = _sized("depth", np.asarray(depth), camera, 1)
    if image.dtype == np.uint16:
        return wire.DepthImage(
            encoding=wire.DEPTH_ENCODING_U16,
            units_per_metre=units_per_metre,
            data=image.astype("<u2", copy=False).tobytes(),
        )
    if image.dtype.kind == "f":
        return wire.DepthImage(
            encoding=wire.DEPTH_ENCODING_F32_METRES,
            data=image.astype("<f4", copy=False).tobytes(),
        )
    problem = f"depth: {image.dtype} is neither uint16 nor floats in metres"
    raise InvalidArgumentError(problem, field="depth")


def _color(color: Any, camera: Intrinsics) -> wire.ColorImage:
    if _is_bytes(color):
        data = bytes(color)
        kinds = {_PNG: wire.COLOR_ENCODING_PNG, _JPEG: wire.COLOR_ENCODING_JPEG}
        for magic, encoding in kinds.items():
            if data.startswith(magic):
                return wire.ColorImage(encoding=encoding, data=data)
        raise InvalidArgumentError("color: these bytes are neither PNG nor JPEG", field="color")
    image = _sized("color", np.asarray(color), camera, 3)
    if image.dtype != np.uint8:
        raise InvalidArgumentError(f"color: {image.dtype} is not uint8", field="color")
    return wire.ColorImage(encoding=wire.COLOR_ENCODING_RGB8, data=image.tobytes())


def _labels(labels: Labels) -> wire.LabelImage:
    message = wire.LabelImage(
        classes=[wire.LabelClass(id=int(i), name=name) for i, name in labels.classes.items()]
    )
    if _is_bytes(labels.ids):
        message.encoding, message.data = wire.LABEL_ENCODING_PNG, bytes(labels.ids)
        return message
    ids = np.asarray(labels.ids)
    if (
        ids.ndim != 2
        or ids.dtype.kind not in "iub"
        or (ids.size and (ids.min() < 0 or ids.max() > 65535))
    ):
        problem = f"labels: {ids.dtype} of shape {ids.shape} is no (H, W) of ids from 0 to 65535"
        raise InvalidArgumentError(problem, field="labels")
    message.height, message.width = ids.shape
    message.encoding = wire.LABEL_ENCODING_U16
    message.data = ids.astype("<u2").tobytes()
    return message


def _features(features: Features) -> wire.FeatureImage:
    values = np.asarray(features.values)
    axes = 3 if features.index is None else 2
    if values.ndim != axes or values.dtype.kind != "f":
        problem = f"features: {values.dtype} of shape {values.shape} is not {axes} axes of floats"
        raise InvalidArgumentError(problem, field="features")
    half = values.dtype == np.float16
    index = b""
    height, width = values.shape[:2]
    if features.index is not None:
        pixels = np.asarray(features.index)
        if pixels.ndim != 2:
            raise InvalidArgumentError(f"features: index of shape {pixels.shape}", field="features")
        height, width = pixels.shape
        index = pixels.astype("<u2").tobytes()
    return wire.FeatureImage(
        encoder_id=features.encoder_id,
        height=height,
        width=width,
        dimension=values.shape[-1],
        encoding=wire.FEATURE_ENCODING_F16 if half else wire.FEATURE_ENCODING_F32,
        data=values.astype("<f2" if half else "<f4", copy=False).tobytes(),
        index=index,
    )


@dataclass(frozen=True)
class Ack:
    """What became of a frame."""

    robot_id: str
    sensor_id: str
    # The stream's own count, from 0.
    seq: int
    # "accepted", where there is a journal "durable" (on the disk, a crash does not lose it), and then one
    # of "integrated", "dropped", "rejected"; "lost": nothing was heard of it.
    status: str
    # Why it was dropped or rejected, as in "replaced", "pose_not_rigid".
    reason: str
    field: str
    # The same in words. Of an integrated frame: why it is not durable, where there is a journal and no
    # "durable" came before.
    message: str
    # Of an integrated frame the first epoch that holds it.
    epoch: int
    newest_stamp_ns: int
    server_us: int
    queue_depth: int
    queue_capacity: int
    # How many more frames the sensor may send now.
    credit: int

    @property
    def is_final(self) -> bool:
        """Nothing more will be said of this frame."""
        return self.status not in ("accepted", "durable")


def read_ack(ack: wire.FrameAck) -> Ack:
    """An ack of a message."""
    status = enum_name(wire.FrameStatus, "FRAME_STATUS_", ack.status)
    reason = enum_name(wire.FrameReason, "FRAME_REASON_", ack.reason)
    return Ack(
        ack.robot_id,
        ack.sensor_id,
        ack.seq,
        "lost" if status == "unspecified" else status,
        "" if reason == "unspecified" else reason,
        ack.field,
        ack.message,
        ack.epoch,
        ack.newest_stamp_ns,
        ack.server_us,
        ack.queue_depth,
        ack.queue_capacity,
        ack.credit,
    )
