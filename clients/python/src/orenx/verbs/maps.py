"""What maps there are and how they are (maps.proto)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from google.protobuf.json_format import MessageToDict

from ..geometry import Box, Intrinsics, box, pose
from ..types import F64
from ..v1 import maps_pb2
from . import Answer, Ask, head


@dataclass(frozen=True, eq=False)
class MapSummary:
    """One map, in short."""

    map_id: str
    epoch: int
    newest_stamp_ns: int
    # Around everything observed; None while the map is empty.
    bounds: Box | None
    modalities: list[str]
    # Why the map is not served; empty if it is.
    problem: str


@dataclass(frozen=True, eq=False)
class MapInfo(Answer):
    """One map, and what it was made with, in the words of the settings file."""

    map: MapSummary
    settings: dict[str, Any]


@dataclass(frozen=True)
class FrameCounts:
    """What became of frames since the server started."""

    received: int
    integrated: int
    dropped: dict[str, int]
    rejected: dict[str, int]
    waiting: int
    lost: int


@dataclass(frozen=True, eq=False)
class Robot:
    """What one robot sent to one map, and where its camera stood last."""

    robot_id: str
    sensor_id: str
    counts: FrameCounts
    newest_stamp_ns: int
    world_from_camera: F64 | None
    intrinsics: Intrinsics | None


@dataclass(frozen=True)
class Storage:
    """How a map is kept on disk."""

    # The epoch that the map's file holds, and when it was written, Unix ns; zeros: not by this process.
    saved_epoch: int
    saved_ns: int
    # Whether frames are journaled; bytes of the journal, and frames in it.
    journal: bool
    journal_bytes: int
    journal_frames: int
    # What was brought back when the map was loaded; empty if nothing was.
    recovery: str


@dataclass(frozen=True, eq=False)
class MapStats(Answer):
    """Sizes, counters and times of a map."""

    map: MapSummary
    counts: FrameCounts
    robots: list[Robot]
    # What is wrong with saving the map or with its journal; empty if nothing is.
    storage_problem: str
    storage: Storage
    losses: dict[str, float]
    # Of the last frame.
    stages_ms: dict[str, float]
    # The other numbers by their names in GetMapStatsReply: frames, steps, voxels, rows, map_bytes, …
    numbers: dict[str, int]


@dataclass(frozen=True)
class Reset:
    """The first epoch of a map that was emptied or restored, and how many frames waited and were dropped."""

    epoch: int
    frames_dropped: int


def _summary(message: maps_pb2.MapSummary) -> MapSummary:
    return MapSummary(
        message.map_id,
        message.epoch,
        message.newest_stamp_ns,
        box(message.bounds) if message.HasField("bounds") else None,
        list(message.modalities),
        message.problem,
    )


def _counts(message: maps_pb2.FrameCounts) -> FrameCounts:
    return FrameCounts(
        message.received,
        message.integrated,
        {count.name: count.count for count in message.dropped},
        {count.name: count.count for count in message.rejected},
        message.waiting,
        message.lost,
    )


def _robot(message: maps_pb2.RobotReport) -> Robot:
    there = message.HasField("world_from_camera")
    seen = message.HasField("intrinsics")
    return Robot(
        message.robot_id,
        message.sensor_id,
        _counts(message.counts),
        message.newest_stamp_ns,
        pose(message.world_from_camera) if there else None,
        Intrinsics.from_wire(message.intrinsics) if seen else None,
    )


def _storage(message: maps_pb2.MapStorage) -> Storage:
    return Storage(
        message.saved_epoch,
        message.saved_ns,
        message.journal,
        message.journal_bytes,
        message.journal_frames,
        message.recovery,
    )


def _read_info(data: bytes) -> MapInfo:
    reply = maps_pb2.GetMapReply.FromString(data)
    settings = MessageToDict(reply.settings, preserving_proto_field_name=True)
    return MapInfo(map=_summary(reply.map), settings=settings, **head(reply))


def _read_stats(data: bytes) -> MapStats:
    reply = maps_pb2.GetMapStatsReply.FromString(data)
    said = ("epoch", "newest_stamp_ns", "server_us")
    numbers = {
        field.name: int(getattr(reply, field.name))
        for field in reply.DESCRIPTOR.fields
        if field.cpp_type == field.CPPTYPE_UINT64 and field.name not in said
    }
    return MapStats(
        map=_summary(reply.map),
        counts=_counts(reply.counts),
        robots=[_robot(robot) for robot in reply.robots],
        storage_problem=reply.storage_problem,
        storage=_storage(reply.storage),
        losses={loss.name: loss.value for loss in reply.losses},
        stages_ms={stage.name: stage.value for stage in reply.stages_ms},
        numbers=numbers,
        **head(reply),
    )


def _read_list(data: bytes) -> list[MapSummary]:
    return [_summary(map_) for map_ in maps_pb2.ListMapsReply.FromString(data).maps]


def _read_reset(data: bytes) -> Reset:
    reply = maps_pb2.ResetMapReply.FromString(data)
    return Reset(reply.epoch, reply.frames_dropped)


def info(map_id: str, *, timeout_s: float | None = None) -> Ask[MapInfo]:
    """The map and its settings."""
    request = maps_pb2.GetMapRequest(map_id=map_id).SerializeToString()
    return Ask("Maps/GetMap", "map", map_id, "GetMapRequest", request, _read_info, timeout_s)


def stats(map_id: str, *, timeout_s: float | None = None) -> Ask[MapStats]:
    """Sizes, counters and times, and the robots that sent frames."""
    request = maps_pb2.GetMapStatsRequest(map_id=map_id).SerializeToString()
    return Ask(
        "Maps/GetMapStats", "stats", map_id, "GetMapStatsRequest", request, _read_stats, timeout_s
    )


def reset(map_id: str, *, timeout_s: float | None = None) -> Ask[Reset]:
    """Empties the map; its settings stay."""
    request = maps_pb2.ResetMapRequest(map_id=map_id).SerializeToString()
    return Ask("Maps/ResetMap", None, map_id, "ResetMapRequest", request, _read_reset, timeout_s)


def list_maps(*, timeout_s: float | None = None) -> Ask[list[MapSummary]]:
    """All maps of the server."""
    request = maps_pb2.ListMapsRequest().SerializeToString()
    return Ask("Maps/ListMaps", None, "", "ListMapsRequest", request, _read_list, timeout_s)


def create_map(
    map_id: str,
    settings: Mapping[str, object] | None = None,
    *,
    timeout_s: float | None = None,
) -> Ask[MapInfo]:
    """Makes an empty map. Settings are those of [map] that differ, as in {"r0_m": 0.05}."""
    said = {key: str(value) for key, value in (settings or {}).items()}
    request = maps_pb2.CreateMapRequest(map_id=map_id, settings=said).SerializeToString()
    return Ask("Maps/CreateMap", None, map_id, "CreateMapRequest", request, _read_info, timeout_s)


def delete_map(map_id: str, *, timeout_s: float | None = None) -> Ask[None]:
    """Deletes a map and all that is stored of it."""
    request = maps_pb2.DeleteMapRequest(map_id=map_id).SerializeToString()

    def read(data: bytes) -> None:
        maps_pb2.DeleteMapReply.FromString(data)

    return Ask("Maps/DeleteMap", None, map_id, "DeleteMapRequest", request, read, timeout_s)
