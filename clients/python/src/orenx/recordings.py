"""Recorded frames from a folder, in the layout of 7-Scenes or TUM RGB-D.

Images are passed on as they are, without being decoded: the server takes PNG and JPEG.
"""

from __future__ import annotations

import bisect
import json
import pathlib
import re
import struct
from collections.abc import Iterator
from typing import Union

import numpy as np

from .errors import InvalidArgumentError, NotFoundError
from .frames import Frame, Labels
from .geometry import Intrinsics
from .types import F64

Folder = Union[str, pathlib.Path]

# 7-Scenes tells no time; its camera had 30 Hz.
_PERIOD_NS = 33_333_333
# The farthest that stamps of one frame of TUM RGB-D may lie apart.
_MAX_APART_S = 0.02
# fx, fy, cx, cy as published with the benchmark, by a part of the folder's name.
_TUM = {
    "freiburg1": (517.3, 516.5, 318.6, 255.3),
    "freiburg2": (520.9, 521.0, 325.1, 249.7),
    "freiburg3": (535.4, 539.2, 320.1, 247.6),
}


def frames(folder: Folder, *, labels: bool = False, stride: int = 1) -> Iterator[Frame]:
    """The frames of a folder, each read when it is wanted.

    Beside frame-*.depth.png (16 bits, mm), .color.jpg or .png and .pose.txt (4x4, camera to world) stands
    camera-intrinsics.txt (3x3); or depth.txt, rgb.txt and groundtruth.txt as in TUM RGB-D. With labels, and
    a labels.json in the folder, frames have their frame-*.label.png.
    """
    path = pathlib.Path(folder)
    if not path.is_dir():
        raise NotFoundError(f"{path} is no folder")
    if next(path.glob("frame-*.depth.png"), None) is not None:
        return _seven_scenes(path, labels, stride)
    if (path / "depth.txt").exists():
        return _tum(path, stride)
    raise InvalidArgumentError(f"folder: {path} has neither frame-*.depth.png nor depth.txt")


def _png_size(data: bytes, path: pathlib.Path) -> tuple[int, int]:
    if data[:8] != b"\x89PNG\r\n\x1a\n" or len(data) < 24:
        raise InvalidArgumentError(f"folder: {path} is no PNG")
    width, height = struct.unpack(">II", data[16:24])
    return int(width), int(height)


def _numbers(path: pathlib.Path, count: int) -> F64:
    values = np.array(path.read_text().split(), np.float64)
    if values.size != count:
        raise InvalidArgumentError(f"folder: {path} has {values.size} numbers instead of {count}")
    return values


def _camera(folder: pathlib.Path, first: pathlib.Path) -> Intrinsics:
    width, height = _png_size(first.read_bytes(), first)
    path = folder / "camera-intrinsics.txt"
    if path.exists():
        return Intrinsics.of_matrix(_numbers(path, 9).reshape(3, 3), width, height)
    for part, (fx, fy, cx, cy) in _TUM.items():
        if part in folder.name:
            return Intrinsics(fx, fy, cx, cy, width, height)
    raise NotFoundError(f"{path} is missing: nine numbers, fx 0 cx, 0 fy cy, 0 0 1")


def _seven_scenes(folder: pathlib.Path, labels: bool, stride: int) -> Iterator[Frame]:
    depths = sorted(folder.glob("frame-*.depth.png"))
    camera = _camera(folder, depths[0])
    classes: dict[int, str] = {}
    if labels and (folder / "labels.json").exists():
        named = json.loads((folder / "labels.json").read_text())["classes"]
        classes = {int(id_): str(name) for id_, name in named.items()}
    for path in depths[::stride]:
        stem = path.name[: -len(".depth.png")]
        number = int(re.sub(r"\D", "", stem))
        colors = (folder / f"{stem}.color.{kind}" for kind in ("jpg", "png"))
        color = next((file.read_bytes() for file in colors if file.exists()), None)
        pose = _numbers(folder / f"{stem}.pose.txt", 16).reshape(4, 4)
        label = folder / f"{stem}.label.png"
        yield Frame(
            path.read_bytes(),
            pose,
            camera,
            color=color,
            stamp_ns=number * _PERIOD_NS,
            labels=Labels(label.read_bytes(), classes) if classes and label.exists() else None,
        )


def _listed(path: pathlib.Path) -> list[tuple[float, str]]:
    lines = [line.split() for line in path.read_text().splitlines()]
    return [(float(line[0]), line[1]) for line in lines if line and not line[0].startswith("#")]


def _tum(folder: pathlib.Path, stride: int) -> Iterator[Frame]:
    depths = _listed(folder / "depth.txt")
    colors = sorted(_listed(folder / "rgb.txt")) if (folder / "rgb.txt").exists() else []
    poses = np.loadtxt(folder / "groundtruth.txt", np.float64, ndmin=2)
    poses = poses[np.argsort(poses[:, 0])]
    camera = _camera(folder, folder / depths[0][1])
    for stamp, name in depths[::stride]:
        pose = _pose_at(poses, stamp)
        if pose is None:
            continue
        at = bisect.bisect(colors, (stamp, ""))
        near = [c for c in colors[max(0, at - 1) : at + 1] if abs(c[0] - stamp) <= _MAX_APART_S]
        best = min(near, key=lambda c: abs(c[0] - stamp), default=None)
        yield Frame(
            (folder / name).read_bytes(),
            pose,
            camera,
            color=None if best is None else (folder / best[1]).read_bytes(),
            stamp_ns=round(stamp * 1e9),
            units_per_metre=5000.0,
        )


def _pose_at(poses: F64, stamp: float) -> F64 | None:
    """The pose at a time, between the two around it; None where there are none."""
    at = int(np.searchsorted(poses[:, 0], stamp))
    low, high = max(at - 1, 0), min(at, len(poses) - 1)
    before, after = poses[low], poses[high]
    if max(abs(before[0] - stamp), abs(after[0] - stamp)) > _MAX_APART_S:
        near = before if abs(before[0] - stamp) < abs(after[0] - stamp) else after
        return near[1:] if abs(near[0] - stamp) <= _MAX_APART_S else None
    span = after[0] - before[0]
    share = (stamp - before[0]) / span if span > 0 else 0.0
    end = after[1:].copy()
    if before[4:] @ end[3:] < 0:  # the same rotation, the short way
        end[3:] = -end[3:]
    pose = before[1:] + share * (end - before[1:])
    pose[3:] /= np.linalg.norm(pose[3:])
    return np.asarray(pose)
