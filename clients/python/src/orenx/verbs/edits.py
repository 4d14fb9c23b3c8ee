"""Changes by hand (maps.proto): what is forgotten, and known geometry that is put in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Union

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InvalidArgumentError
from ..geometry import Box, box_to_wire, pose_to_wire, rows, vector_to_wire
from ..v1 import maps_pb2
from . import Ask, enum


@dataclass(frozen=True, eq=False)
class Sphere:
    """A ball in world metres."""

    center: ArrayLike
    radius_m: float

    def to_wire(self) -> maps_pb2.Sphere:
        """As a message."""
        return maps_pb2.Sphere(
            center=vector_to_wire("sphere.center", self.center), radius_m=float(self.radius_m)
        )


@dataclass(frozen=True, eq=False)
class SolidBox:
    """A box that may be turned: its middle and axes as a pose, and its edge lengths."""

    world_from_box: ArrayLike
    size_m: ArrayLike

    def to_wire(self) -> maps_pb2.OrientedSolidBox:
        """As a message."""
        return maps_pb2.OrientedSolidBox(
            world_from_box=pose_to_wire("box.world_from_box", self.world_from_box),
            size_m=vector_to_wire("box.size_m", self.size_m),
        )


@dataclass(frozen=True, eq=False)
class Mesh:
    """(V, 3) vertices in world metres, and (T, 3) triangles, counterclockwise seen from outside."""

    vertices_m: ArrayLike
    triangles: ArrayLike

    def to_wire(self) -> maps_pb2.TriangleMesh:
        """As a message."""
        vertices = rows("mesh.vertices_m", self.vertices_m, 3)
        field, triangles = "mesh.triangles", np.asarray(self.triangles)
        if triangles.ndim != 2 or triangles.shape[1] != 3 or triangles.dtype.kind not in "iu":
            problem = f"{triangles.dtype} of shape {triangles.shape} is no (T, 3) of integers"
            raise InvalidArgumentError(f"{field}: {problem}", field=field)
        if triangles.size and not 0 <= triangles.min() <= triangles.max() < len(vertices):
            problem = f"{triangles.min()} to {triangles.max()} of {len(vertices)} vertices"
            raise InvalidArgumentError(f"{field}: {problem}", field=field)
        return maps_pb2.TriangleMesh(
            vertices_m=vertices.ravel().tolist(), triangles=triangles.ravel().tolist()
        )


Solid = Union[SolidBox, Sphere, Mesh]


@dataclass(frozen=True)
class Edit:
    """What a change by hand did."""

    # The first epoch that holds it.
    epoch: int
    surfels_removed: int
    # New surfels, and those that took another's place.
    surfels_added: int
    # Cells of evidence, 0.1 m each, that are unknown again, and those that were told occupied or free.
    cells_forgotten: int
    cells_told: int
    # Views of a robot that training had kept.
    key_frames_dropped: int
    server_us: int


def _read(data: bytes) -> Edit:
    reply = maps_pb2.EditReply.FromString(data)
    return Edit(
        reply.epoch,
        reply.surfels_removed,
        reply.surfels_added,
        reply.cells_forgotten,
        reply.cells_told,
        reply.key_frames_dropped,
        reply.server_us,
    )


def _ask(
    method: str,
    request: maps_pb2.ClearRegionRequest | maps_pb2.StampGeometryRequest,
    timeout_s: float | None,
) -> Ask[Edit]:
    encoded = request.SerializeToString()
    return Ask(
        f"Maps/{method}", None, request.map_id, f"{method}Request", encoded, _read, timeout_s
    )


def clear(
    map_id: str,
    region: Box | Sphere | ArrayLike | None = None,
    *,
    robot_id: str = "",
    older_than_ns: int | None = None,
    timeout_s: float | None = None,
) -> Ask[Edit]:
    """Forgets what was seen in a box (low and high corner) or sphere, by one robot, or before a time.

    At least one of them must be given; of several, what fits all is forgotten.
    """
    request = maps_pb2.ClearRegionRequest(
        map_id=map_id, robot_id=robot_id, older_than_ns=older_than_ns
    )
    if isinstance(region, Sphere):
        request.sphere.CopyFrom(region.to_wire())
    elif region is not None:
        request.box.CopyFrom(box_to_wire("region", region))
    return _ask("ClearRegion", request, timeout_s)


def stamp(
    map_id: str,
    solid: Solid,
    *,
    mode: Literal["add", "free"] = "add",
    robot_id: str = "",
    color: ArrayLike | None = None,
    timeout_s: float | None = None,
) -> Ask[Edit]:
    """Puts a solid into the map ("add"), or tells that its space is free ("free").

    robot_id: under whose name it is there, to be cleared by; "stamp" if empty. color: sRGB, each 0 to 1.
    """
    request = maps_pb2.StampGeometryRequest(
        map_id=map_id,
        mode=enum(maps_pb2.StampMode, "STAMP_MODE_", "mode", mode),
        robot_id=robot_id,
    )
    if color is not None:
        srgb = vector_to_wire("color", color)
        request.color.CopyFrom(maps_pb2.StampColor(r=srgb.x, g=srgb.y, b=srgb.z))
    if isinstance(solid, SolidBox):
        request.box.CopyFrom(solid.to_wire())
    elif isinstance(solid, Sphere):
        request.sphere.CopyFrom(solid.to_wire())
    elif isinstance(solid, Mesh):
        request.mesh.CopyFrom(solid.to_wire())
    else:
        problem = f"solid: {type(solid).__name__} is no SolidBox, Sphere or Mesh"
        raise InvalidArgumentError(problem, field="solid")
    return _ask("StampGeometry", request, timeout_s)
