"""Points, poses, cameras and boxes: numpy to messages and back.

Metres; a pose is a 4x4 matrix `world_from_camera` or seven numbers x y z, qx qy qz qw; camera axes are
optical (x right, y down, z forward), world z is up.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .errors import InvalidArgumentError
from .types import F32, F64
from .v1 import geometry_pb2 as wire


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera without distortion, in pixels; an integer pixel is a pixel's centre."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    @classmethod
    def of_fov(cls, width: int, height: int, fov_deg: float) -> Intrinsics:
        """A camera with this angle of view between its left and its right side."""
        f = width / 2 / float(np.tan(np.radians(fov_deg) / 2))
        return cls(f, f, (width - 1) / 2, (height - 1) / 2, width, height)

    @classmethod
    def of_matrix(cls, k: ArrayLike, width: int, height: int) -> Intrinsics:
        """A camera with this 3x3 matrix."""
        m = _array("intrinsics", k, (3, 3))
        return cls(m[0, 0], m[1, 1], m[0, 2], m[1, 2], width, height)

    @property
    def matrix(self) -> F64:
        """The 3x3 matrix."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], np.float64)

    def to_wire(self) -> wire.Intrinsics:
        """As a message."""
        return wire.Intrinsics(
            fx=float(self.fx),
            fy=float(self.fy),
            cx=float(self.cx),
            cy=float(self.cy),
            width=int(self.width),
            height=int(self.height),
        )

    @classmethod
    def from_wire(cls, message: wire.Intrinsics) -> Intrinsics:
        """Of a message."""
        m = message
        return cls(m.fx, m.fy, m.cx, m.cy, m.width, m.height)


@dataclass(frozen=True, eq=False)
class Box:
    """A box along the world's axes."""

    min: F64
    max: F64

    @property
    def size(self) -> F64:
        """Its sides, m."""
        return self.max - self.min

    @property
    def center(self) -> F64:
        """Its middle."""
        return (self.min + self.max) / 2

    def __iter__(self) -> Iterator[F64]:
        """Its corners, so that a box may stand wherever a pair of corners may."""
        return iter((self.min, self.max))


def _array(field: str, values: ArrayLike, shape: tuple[int | None, ...]) -> F64:
    """Numbers of a shape, of which some sides are free."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(f"{field}: {error}", field=field) from None
    fits = array.ndim == len(shape) and all(w in (None, h) for w, h in zip(shape, array.shape))
    if not fits:
        wanted = ", ".join("N" if side is None else str(side) for side in shape)
        raise InvalidArgumentError(f"{field}: shape {array.shape} is not ({wanted})", field=field)
    return array


def rows(field: str, values: ArrayLike, width: int) -> F32:
    """(N, width) numbers, or one row of them, as f32."""
    try:
        array = np.asarray(values, dtype=np.float32)
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(f"{field}: {error}", field=field) from None
    if array.ndim == 1 and array.shape[0] == width:
        array = array[None]
    if array.ndim != 2 or array.shape[1] != width:
        raise InvalidArgumentError(f"{field}: shape {array.shape} is not (N, {width})", field=field)
    return array


def vector_to_wire(field: str, values: ArrayLike) -> wire.Vector3:
    """Three numbers as a message."""
    x, y, z = _array(field, values, (3,)).tolist()
    return wire.Vector3(x=x, y=y, z=z)


def vector(message: wire.Vector3) -> F64:
    """Three numbers of a message."""
    return np.array([message.x, message.y, message.z], np.float64)


def box_to_wire(field: str, box: Box | ArrayLike) -> wire.Aabb:
    """A pair of corners, low and high, as a message."""
    low, high = _array(field, list(box) if isinstance(box, Box) else box, (2, 3))
    return wire.Aabb(
        min=vector_to_wire(field, low),
        max=vector_to_wire(field, high),
    )


def box(message: wire.Aabb) -> Box:
    """A box of a message."""
    return Box(vector(message.min), vector(message.max))


def quaternion_of(rotation: F64) -> F64:
    """x y z w of (…, 3, 3) rotations."""
    m = rotation
    # Four times the square of each component; the largest one divides, so that nothing cancels.
    trace = m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2]
    squares = np.stack(
        [
            1 - trace + 2 * m[..., 0, 0],
            1 - trace + 2 * m[..., 1, 1],
            1 - trace + 2 * m[..., 2, 2],
            1 + trace,
        ],
        axis=-1,
    )
    x, y, z = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    xy, xz, yz = (
        m[..., 0, 1] + m[..., 1, 0],
        m[..., 0, 2] + m[..., 2, 0],
        m[..., 1, 2] + m[..., 2, 1],
    )
    rows_ = np.stack(
        [
            np.stack([squares[..., 0], xy, xz, x], -1),
            np.stack([xy, squares[..., 1], yz, y], -1),
            np.stack([xz, yz, squares[..., 2], z], -1),
            np.stack([x, y, z, squares[..., 3]], -1),
        ],
        axis=-2,
    )
    largest = np.argmax(squares, axis=-1)
    q = np.take_along_axis(rows_, largest[..., None, None], axis=-2)[..., 0, :]
    return np.asarray(q / np.linalg.norm(q, axis=-1, keepdims=True), np.float64)


def rotation_of(quaternion: ArrayLike) -> F64:
    """(…, 3, 3) rotations of unit quaternions x y z w."""
    q = np.asarray(quaternion, np.float64)
    x, y, z, w = np.moveaxis(q, -1, 0)
    entries = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in entries], axis=-2)


def poses_flat(field: str, poses: ArrayLike) -> F64:
    """(…, 7) of (…, 7) or (…, 4, 4) poses."""
    try:
        array = np.asarray(poses, np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(f"{field}: {error}", field=field) from None
    if array.ndim >= 2 and array.shape[-2:] == (4, 4):
        quaternion = quaternion_of(array[..., :3, :3])
        return np.concatenate([array[..., :3, 3], quaternion], axis=-1)
    if array.ndim >= 1 and array.shape[-1] == 7:
        return array
    problem = f"{field}: shape {array.shape} is neither (…, 4, 4) nor (…, 7)"
    raise InvalidArgumentError(problem, field=field)


def pose_to_wire(field: str, pose: ArrayLike) -> wire.Pose:
    """One pose as a message. A matrix that is no rigid transform is left to the server to refuse."""
    flat = poses_flat(field, pose)
    if flat.shape != (7,):
        raise InvalidArgumentError(f"{field}: {flat.shape[:-1]} poses instead of one", field=field)
    array = np.asarray(pose, np.float64)
    if array.shape == (4, 4):
        r = array[:3, :3]
        off = float(np.abs(r @ r.T - np.eye(3)).max())
        if not off <= 2e-2 or not np.linalg.det(r) > 0:
            problem = f"{field}: the rotation is off by {off:.3g} from a rigid one"
            raise InvalidArgumentError(problem, field=field)
    x, y, z, qx, qy, qz, qw = flat.tolist()
    return wire.Pose(
        translation=wire.Vector3(x=x, y=y, z=z),
        rotation=wire.Quaternion(x=qx, y=qy, z=qz, w=qw),
    )


def pose(message: wire.Pose) -> F64:
    """The 4x4 matrix of a message."""
    q = message.rotation
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_of([q.x, q.y, q.z, q.w])
    matrix[:3, 3] = vector(message.translation)
    return matrix


def look_at(eye: ArrayLike, target: ArrayLike) -> F64:
    """The pose of a camera at `eye` that looks at `target` and stands upright."""
    eye_, target_ = _array("eye", eye, (3,)), _array("target", target, (3,))
    forward = target_ - eye_
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    if np.linalg.norm(right) < 1e-6:  # straight up or down
        right = np.array([1.0, 0.0, 0.0])
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    matrix[:3, 3] = eye_
    return matrix
