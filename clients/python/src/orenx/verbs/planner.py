"""The questions that planners ask (planner.proto)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import Unpack

from .. import packed
from ..errors import InvalidArgumentError
from ..geometry import Box, box_to_wire, poses_flat, rows, vector
from ..types import F32, F64, I8, U8, Bool
from ..v1 import planner_pb2, query_pb2
from . import Answer, Ask, Fresh, Seen, Terms, enum_name, head, terms_to_wire
from .query import Columns, Field, bytes_of, point_fields, wide

RAY_FREE, RAY_HIT, RAY_UNKNOWN = 1, 2, 3


def _numbers(reply: Any, *names: str) -> dict[str, int]:
    return {name: reply.DESCRIPTOR.fields_by_name[name].number for name in names}


# --- spheres


@dataclass(frozen=True, eq=False)
class Spheres(Columns):
    """The answer for spheres: `clearance` (N,) is the distance of the center less the radius, m."""

    clearance: F32 | None


_SPHERES = _numbers(planner_pb2.QuerySpheresReply, "clearance_m", "gradient", "occupancy", "color")


def _read_spheres(data: bytes) -> Spheres:
    columns, rest = packed.split(data, _SPHERES.values())
    reply = planner_pb2.QuerySpheresReply.FromString(rest)
    return Spheres(
        clearance=columns.get(_SPHERES["clearance_m"]),
        gradient=wide(columns.get(_SPHERES["gradient"])),
        occupancy=columns.get(_SPHERES["occupancy"]),
        state=bytes_of(reply.state),
        color=wide(columns.get(_SPHERES["color"])),
        **head(reply),
    )


def query_spheres(
    map_id: str,
    spheres: ArrayLike,
    *,
    fields: Iterable[Field] | None = None,
    **terms: Unpack[Terms],
) -> Ask[Spheres]:
    """How far (N, 4) spheres x y z r are from surfaces, m: clearance, gradient and state.

    A sphere is unknown if its center is.
    """
    request = planner_pb2.QuerySpheresRequest(
        map_id=map_id, fields=point_fields(fields), **terms_to_wire(terms)
    )
    field = planner_pb2.QuerySpheresRequest.SPHERES_M_FIELD_NUMBER
    return Ask(
        "Planner/QuerySpheres",
        "spheres",
        map_id,
        "QuerySpheresRequest",
        packed.write(request, [(field, rows("spheres", spheres, 4))]),
        _read_spheres,
        terms.get("timeout_s"),
    )


# --- trajectories


@dataclass(frozen=True)
class Place:
    """A place on a trajectory: a pose, the share of the way to the next one, and a sphere."""

    pose: int
    fraction: float
    sphere: int


@dataclass(frozen=True)
class Verdict:
    """What a trajectory is: NaN and None where everything is unknown."""

    min_clearance: float
    min_at: Place | None
    # Where the clearance first falls below the margin.
    first_hit: Place | None
    # Pairs of a pose and a sphere whose center nobody has seen.
    unknown_hits: int

    @property
    def is_safe(self) -> bool:
        """Nothing is hit, and nothing is unknown."""
        return self.first_hit is None and self.unknown_hits == 0


@dataclass(frozen=True, eq=False)
class Verdicts(Answer):
    """One verdict a trajectory, in the order of the question."""

    trajectories: list[Verdict]

    @property
    def safe(self) -> Bool:
        """Which of them are safe."""
        return np.array([verdict.is_safe for verdict in self.trajectories], np.bool_)

    @property
    def min_clearance(self) -> F32:
        """The least clearance of each, m."""
        return np.array([verdict.min_clearance for verdict in self.trajectories], np.float32)


def _place(verdict: planner_pb2.TrajectoryVerdict, name: str) -> Place | None:
    if not verdict.HasField(name):
        return None
    place = getattr(verdict, name)
    return Place(place.pose, place.fraction, place.sphere)


def _verdicts(reply: planner_pb2.CheckTrajectoriesReply) -> Verdicts:
    verdicts = [
        Verdict(v.min_clearance_m, _place(v, "min_at"), _place(v, "first_hit"), v.unknown_hits)
        for v in reply.trajectories
    ]
    return Verdicts(trajectories=verdicts, **head(reply))


def _check_request(
    map_id: str,
    spheres: ArrayLike,
    trajectories: ArrayLike | Sequence[ArrayLike],
    margin_m: float,
    swept: bool,
    terms: Terms,
) -> bytes:
    if isinstance(trajectories, np.ndarray) and trajectories.dtype != object:
        flat = poses_flat("trajectories", trajectories)
        several = flat[None] if flat.ndim == 2 else flat
        if several.ndim != 3:
            problem = (
                f"trajectories: shape {trajectories.shape} is not ([T,] P, 7) or ([T,] P, 4, 4)"
            )
            raise InvalidArgumentError(problem, field="trajectories")
        each: list[F64] = list(several)
    else:
        each = [poses_flat(f"trajectories[{i}]", t) for i, t in enumerate(trajectories)]  # type: ignore[arg-type]
        if each and each[0].ndim == 1:  # one trajectory, as a list of poses
            each = [np.stack(each)]
    poses = np.concatenate(each).astype(np.float32) if each else np.zeros((0, 7), np.float32)
    request = planner_pb2.CheckTrajectoriesRequest(
        map_id=map_id,
        lengths=[len(trajectory) for trajectory in each],
        margin_m=margin_m,
        swept=swept,
        **terms_to_wire(terms),
    )
    kind = planner_pb2.CheckTrajectoriesRequest
    return packed.write(
        request,
        [
            (kind.SPHERES_M_FIELD_NUMBER, rows("spheres", spheres, 4)),
            (kind.POSES_FIELD_NUMBER, poses),
        ],
    )


def check_trajectories(
    map_id: str,
    spheres: ArrayLike,
    trajectories: ArrayLike | Sequence[ArrayLike],
    *,
    margin_m: float = 0.0,
    swept: bool = False,
    **terms: Unpack[Terms],
) -> Ask[Verdicts]:
    """Whether a robot of (S, 4) spheres, in its body frame, gets along trajectories.

    Trajectories are (T, P, 7) or (T, P, 4, 4) poses world_from_body, or a list of (P, 7) or (P, 4, 4) of
    any lengths; `swept` looks between poses too. A clearance below the margin is a hit.
    """
    return Ask(
        "Planner/CheckTrajectories",
        "trajectories",
        map_id,
        "CheckTrajectoriesRequest",
        _check_request(map_id, spheres, trajectories, margin_m, swept, terms),
        lambda data: _verdicts(planner_pb2.CheckTrajectoriesReply.FromString(data)),
        terms.get("timeout_s"),
    )


# --- rays


@dataclass(frozen=True, eq=False)
class Rays(Answer):
    """What rays met: `state` (N,) is 1 free, 2 hit, 3 unknown; NaN where there is no number."""

    state: U8
    distance: F32
    normal: F32
    # Along the ray to where it first left observed space, m.
    unknown_at: F32

    @property
    def hit(self) -> Bool:
        """Which met a surface."""
        return np.asarray(self.state == RAY_HIT)


_RAYS = _numbers(planner_pb2.CastRaysReply, "distance_m", "normal", "unknown_at_m")


def _read_rays(data: bytes) -> Rays:
    columns, rest = packed.split(data, _RAYS.values())
    reply = planner_pb2.CastRaysReply.FromString(rest)
    none = np.zeros(0, np.float32)
    return Rays(
        state=np.frombuffer(reply.state, np.uint8).copy(),
        distance=columns.get(_RAYS["distance_m"], none),
        normal=columns.get(_RAYS["normal"], none).reshape(-1, 3),
        unknown_at=columns.get(_RAYS["unknown_at_m"], none),
        **head(reply),
    )


def cast_rays(
    map_id: str,
    origins: ArrayLike,
    directions: ArrayLike,
    *,
    max_range_m: float,
    **terms: Unpack[Seen],
) -> Ask[Rays]:
    """What rays meet first: (N, 3) origins, or one for all, and (N, 3) directions of any length but 0."""
    towards = rows("directions", directions, 3)
    begins = np.broadcast_to(rows("origins", origins, 3), towards.shape)
    request = planner_pb2.CastRaysRequest(
        map_id=map_id, max_range_m=max_range_m, **terms_to_wire(terms, Seen)
    )
    kind = planner_pb2.CastRaysRequest
    return Ask(
        "Planner/CastRays",
        "rays",
        map_id,
        "CastRaysRequest",
        packed.write(
            request,
            [(kind.ORIGINS_M_FIELD_NUMBER, begins), (kind.DIRECTIONS_FIELD_NUMBER, towards)],
        ),
        _read_rays,
        terms.get("timeout_s"),
    )


# --- nearest


@dataclass(frozen=True, eq=False)
class Nearest(Answer):
    """The nearest place on a surface to each point: surface (N, 3), distance (N,), state (N,)."""

    surface: F32
    distance: F32
    state: U8
    # How far it is to what nobody has seen, m; None if it was not asked for.
    unknown_distance: F32 | None


_NEAREST = _numbers(planner_pb2.FindNearestReply, "surface_m", "distance_m", "unknown_distance_m")


def _read_nearest(data: bytes) -> Nearest:
    columns, rest = packed.split(data, _NEAREST.values())
    reply = planner_pb2.FindNearestReply.FromString(rest)
    none = np.zeros(0, np.float32)
    return Nearest(
        surface=columns.get(_NEAREST["surface_m"], none).reshape(-1, 3),
        distance=columns.get(_NEAREST["distance_m"], none),
        state=np.frombuffer(reply.state, np.uint8).copy(),
        unknown_distance=columns.get(_NEAREST["unknown_distance_m"]),
        **head(reply),
    )


def nearest(
    map_id: str, points: ArrayLike, *, max_unknown_m: float = 0.0, **fresh: Unpack[Fresh]
) -> Ask[Nearest]:
    """The nearest place on a surface, and how far it is to what nobody has seen, up to max_unknown_m."""
    request = planner_pb2.FindNearestRequest(
        map_id=map_id, max_unknown_m=max_unknown_m, **terms_to_wire(fresh, Fresh)
    )
    field = planner_pb2.FindNearestRequest.POINTS_M_FIELD_NUMBER
    return Ask(
        "Planner/FindNearest",
        "nearest",
        map_id,
        "FindNearestRequest",
        packed.write(request, [(field, rows("points", points, 3))]),
        _read_nearest,
        fresh.get("timeout_s"),
    )


# --- grids and slices


@dataclass(frozen=True, eq=False)
class Grid(Answer):
    """Voxels of a box: columns by field, [x, y, z] or [x, y, z, 3]."""

    # The low corner of the low voxel, world metres.
    origin: F64
    voxel_m: float
    columns: dict[str, NDArray[Any]]

    def __getitem__(self, field: Field) -> NDArray[Any]:
        """A column, as in grid["distance"]."""
        return self.columns[field]

    @property
    def shape(self) -> tuple[int, int, int]:
        """Voxels along x, y, z."""
        x, y, z = next(iter(self.columns.values())).shape[:3]
        return x, y, z

    @property
    def centers(self) -> F64:
        """The center of each voxel, [x, y, z, 3]."""
        places = np.moveaxis(np.indices(self.shape, dtype=np.float64), 0, -1)
        return np.asarray(self.origin + (places + 0.5) * self.voxel_m)


def _read_grid(data: bytes) -> Grid:
    reply = planner_pb2.GetGridReply.FromString(data)
    shape = tuple(reply.size)
    # The place of a voxel is i·stride[0] + j·stride[1] + k·stride[2], in whatever order that is.
    order = np.argsort(np.array(reply.stride))[::-1]
    columns: dict[str, NDArray[Any]] = {}
    for column in reply.columns:
        name = enum_name(query_pb2.PointField, "POINT_FIELD_", column.field)
        half = column.format == planner_pb2.NUMBER_FORMAT_F16
        dtype = np.dtype("u1") if name == "state" else np.dtype("<f2" if half else "<f4")
        numbers = np.frombuffer(column.data, dtype)
        numbers = numbers.reshape(*(shape[i] for i in order), column.width)
        back = np.argsort(order)
        numbers = np.ascontiguousarray(numbers.transpose(*back, 3))
        columns[name] = numbers[..., 0] if column.width == 1 else numbers
    return Grid(
        origin=vector(reply.origin_m), voxel_m=reply.voxel_m, columns=columns, **head(reply)
    )


def grid(
    map_id: str,
    region: Box | ArrayLike,
    voxel_m: float,
    *,
    fields: Iterable[Field] | None = None,
    half: bool = False,
    **terms: Unpack[Terms],
) -> Ask[Grid]:
    """Fields in the voxels of a box (low and high corner): distance and state, or those named."""
    request = planner_pb2.GetGridRequest(
        map_id=map_id,
        region=box_to_wire("region", region),
        voxel_m=voxel_m,
        fields=point_fields(fields),
        format=planner_pb2.NUMBER_FORMAT_F16 if half else planner_pb2.NUMBER_FORMAT_F32,
        **terms_to_wire(terms),
    )
    return Ask(
        "Planner/GetGrid",
        "grid",
        map_id,
        "GetGridRequest",
        request.SerializeToString(),
        _read_grid,
        terms.get("timeout_s"),
    )


@dataclass(frozen=True, eq=False)
class Slice(Answer):
    """A plane or a band of heights: distance or cost, [x, y]."""

    # The low corner of the low cell, and the lowest height.
    origin: F64
    resolution_m: float
    distance: F32 | None
    # 0 to 100, -1 where unknown, as Nav2 reads occupancy grids.
    cost: I8 | None

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom, top in metres, as matplotlib's imshow wants it for `distance.T`."""
        cells = self.distance if self.distance is not None else self.cost
        w, h = cells.shape if cells is not None else (0, 0)
        x, y = float(self.origin[0]), float(self.origin[1])
        return x, x + w * self.resolution_m, y, y + h * self.resolution_m


_SLICE = _numbers(planner_pb2.GetSliceReply, "distance_m")


def _read_slice(data: bytes) -> Slice:
    columns, rest = packed.split(data, _SLICE.values())
    reply = planner_pb2.GetSliceReply.FromString(rest)
    shape = (reply.height, reply.width)
    distance = columns.get(_SLICE["distance_m"])
    cost = np.frombuffer(reply.cost, np.int8) if reply.cost else None
    return Slice(
        origin=vector(reply.origin_m),
        resolution_m=reply.resolution_m,
        distance=None if distance is None else np.ascontiguousarray(distance.reshape(shape).T),
        cost=None if cost is None else np.ascontiguousarray(cost.reshape(shape).T),
        **head(reply),
    )


def slice(
    map_id: str,
    z_m: float,
    *,
    z_max_m: float | None = None,
    resolution_m: float = 0.05,
    region: Box | ArrayLike | None = None,
    costs: tuple[float, float] | None = None,
    **terms: Unpack[Terms],
) -> Ask[Slice]:
    """Distances at a height, or the least of a band of heights; with costs=(robot_radius, inflation) costs.

    Of the region only x and y count; without one it is all that was observed.
    """
    request = planner_pb2.GetSliceRequest(
        map_id=map_id,
        z_m=z_m,
        z_max_m=z_max_m,
        resolution_m=resolution_m,
        region=None if region is None else box_to_wire("region", region),
        costs=None
        if costs is None
        else planner_pb2.SliceCosts(robot_radius_m=costs[0], inflation_m=costs[1]),
        **terms_to_wire(terms),
    )
    return Ask(
        "Planner/GetSlice",
        "slice",
        map_id,
        "GetSliceRequest",
        request.SerializeToString(),
        _read_slice,
        terms.get("timeout_s"),
    )
