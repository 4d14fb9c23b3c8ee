"""Watches (planner.proto): what is asked once and answered again and again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from typing_extensions import Unpack

from ..geometry import Box, box_to_wire, vector
from ..types import F32, F64, U8
from ..v1 import planner_pb2
from . import Ask, Terms
from .planner import Verdicts, _check_request, _verdicts

_EDGE = 8


@dataclass(frozen=True, eq=False)
class Brick:
    """8x8x8 voxels of a region: distance and state [x, y, z]; beyond the region's end unknown."""

    # The place of its low voxel in the region.
    at: tuple[int, int, int]
    distance: F32
    state: U8


@dataclass(frozen=True, eq=False)
class RegionUpdate:
    """What changed in a region; of the first update, all that is known."""

    epoch: int
    newest_stamp_ns: int
    origin: F64
    voxel_m: float
    shape: tuple[int, int, int]
    bricks: list[Brick]

    def write_to(self, distance: F32, state: U8) -> None:
        """Brings arrays of the region's shape up to date. They begin as NaN and 0."""
        for brick in self.bricks:
            place = tuple(np.s_[a : min(a + _EDGE, s)] for a, s in zip(brick.at, self.shape))
            inside = tuple(np.s_[: p.stop - p.start] for p in place)
            distance[place] = brick.distance[inside]
            state[place] = brick.state[inside]


def _brick(brick: planner_pb2.RegionBrick) -> Brick:
    shape = (_EDGE, _EDGE, _EDGE)  # x the fastest: z is the first axis as it lies in memory
    distance = np.array(brick.distance_m, np.float32).reshape(shape).transpose(2, 1, 0)
    state = np.frombuffer(brick.state, np.uint8).reshape(shape).transpose(2, 1, 0)
    return Brick(
        (brick.x * _EDGE, brick.y * _EDGE, brick.z * _EDGE),
        np.ascontiguousarray(distance),
        np.ascontiguousarray(state),
    )


def _read_region(data: bytes) -> RegionUpdate:
    reply = planner_pb2.WatchRegionReply.FromString(data)
    x, y, z = reply.size
    return RegionUpdate(
        reply.epoch,
        reply.newest_stamp_ns,
        vector(reply.origin_m),
        reply.voxel_m,
        (x, y, z),
        [_brick(brick) for brick in reply.bricks],
    )


def watch_region(
    map_id: str,
    region: Box | ArrayLike,
    voxel_m: float,
    *,
    min_interval_ms: int = 0,
    tolerance_m: float = 0.0,
) -> Ask[RegionUpdate]:
    """A box as it is, and then what changes in it by more than the tolerance."""
    request = planner_pb2.WatchRegionRequest(
        map_id=map_id,
        region=box_to_wire("region", region),
        voxel_m=voxel_m,
        min_interval_ms=min_interval_ms,
        tolerance_m=tolerance_m,
    )
    return Ask(
        "Planner/WatchRegion",
        "watch_region",
        map_id,
        "WatchRegionRequest",
        request.SerializeToString(),
        _read_region,
    )


def watch_trajectory(
    map_id: str,
    spheres: ArrayLike,
    trajectories: ArrayLike | Sequence[ArrayLike],
    *,
    margin_m: float = 0.0,
    swept: bool = False,
    drop_m: float = 0.0,
    **terms: Unpack[Terms],
) -> Ask[Verdicts]:
    """What check_trajectories says now, and again when a trajectory becomes safe or unsafe.

    With drop_m also when its least clearance fell by more than that.
    """
    check = _check_request(map_id, spheres, trajectories, margin_m, swept, terms)
    request = planner_pb2.WatchTrajectoryRequest(drop_m=drop_m)
    request.check.ParseFromString(check)
    return Ask(
        "Planner/WatchTrajectory",
        "watch_trajectories",
        map_id,
        "WatchTrajectoryRequest",
        request.SerializeToString(),
        lambda data: _verdicts(planner_pb2.WatchTrajectoryReply.FromString(data).result),
    )
