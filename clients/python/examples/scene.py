"""A simulated room of boxes: depth, color and labels by rays in numpy, and its true distances.

    python scene.py FOLDER     # writes a recording in the layout of 7-Scenes, with labels

It stands for a robot with a depth camera; labels come from the room itself and stand for a segmenter.
"""

from __future__ import annotations

import argparse
import json
import pathlib
import struct
import zlib
from dataclasses import dataclass, field

import numpy as np

import orenx

CLASSES = {1: "floor", 2: "wall", 3: "ceiling", 4: "table", 5: "sofa", 6: "refrigerator"}
COLORS = np.array(
    [
        [0, 0, 0],
        [122, 98, 80],
        [205, 200, 190],
        [240, 240, 240],
        [160, 110, 60],
        [60, 90, 170],
        [225, 230, 235],
    ],
    np.uint8,
)
CAMERA = orenx.Intrinsics.of_fov(160, 120, 75)


@dataclass(frozen=True)
class Thing:
    """A solid box of a class."""

    id: int
    low: tuple[float, float, float]
    high: tuple[float, float, float]


@dataclass(frozen=True)
class Scene:
    """A room that is empty but for some boxes."""

    low: tuple[float, float, float] = (-2.5, -2.0, 0.0)
    high: tuple[float, float, float] = (2.5, 2.0, 2.4)
    things: tuple[Thing, ...] = field(
        default=(
            Thing(4, (-0.5, -0.9, 0.0), (0.5, 0.3, 0.75)),
            Thing(5, (-2.3, -1.2, 0.0), (-1.6, 0.8, 0.7)),
            Thing(6, (1.8, 1.3, 0.0), (2.5, 2.0, 1.8)),
        )
    )

    def distance(self, points: np.ndarray) -> np.ndarray:
        """The true signed distance, in and around the room."""
        low, high = np.array(self.low), np.array(self.high)
        nearest = np.minimum(points - low, high - points).min(axis=-1)
        for thing in self.things:
            center = (np.array(thing.low) + thing.high) / 2
            half = (np.array(thing.high) - thing.low) / 2
            beyond = np.abs(points - center) - half
            outside = np.linalg.norm(np.maximum(beyond, 0), axis=-1)
            nearest = np.minimum(nearest, outside + np.minimum(beyond.max(axis=-1), 0))
        return nearest

    def look(
        self, pose: np.ndarray, camera: orenx.Intrinsics = CAMERA
    ) -> tuple[np.ndarray, np.ndarray]:
        """Depth (m, along the optical axis) and the class of each pixel."""
        v, u = np.mgrid[: camera.height, : camera.width]
        rays = np.stack(
            [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)], -1
        )
        direction = rays @ pose[:3, :3].T
        direction = np.where(np.abs(direction) < 1e-9, 1e-9, direction)
        eye = pose[:3, 3]
        leave = np.maximum(
            (np.array(self.low) - eye) / direction, (np.array(self.high) - eye) / direction
        )
        axis = leave.argmin(axis=-1)
        depth = np.take_along_axis(leave, axis[..., None], -1)[..., 0]
        ids = np.where(axis == 2, np.where(direction[..., 2] < 0, 1, 3), 2)
        for thing in self.things:
            a, b = (np.array(thing.low) - eye) / direction, (np.array(thing.high) - eye) / direction
            enter, out = np.minimum(a, b).max(axis=-1), np.maximum(a, b).min(axis=-1)
            seen = (enter > 0) & (enter < out) & (enter < depth)
            depth = np.where(seen, enter, depth)
            ids = np.where(seen, thing.id, ids)
        return depth.astype(np.float32), ids.astype(np.uint8)

    def frame(
        self, pose: np.ndarray, stamp_ns: int | None = None, *, labels: bool = False
    ) -> orenx.Frame:
        """What the camera sees from there."""
        depth, ids = self.look(pose)
        return orenx.Frame(
            depth,
            pose,
            CAMERA,
            color=COLORS[ids],
            stamp_ns=stamp_ns,
            labels=orenx.Labels(ids, CLASSES) if labels else None,
        )


def tour(count: int) -> list[np.ndarray]:
    """Poses around the room: along an ellipse, looking across it and a little down."""
    poses = []
    for at in np.linspace(0, 2 * np.pi, count, endpoint=False):
        eye = np.array([1.3 * np.cos(at), 1.2 * np.sin(at), 1.5])
        target = np.array([-1.6 * np.cos(at + 0.4), -1.6 * np.sin(at + 0.4), 0.6])
        poses.append(orenx.look_at(eye, target))
    return poses


def frames(count: int, *, labels: bool = False) -> list[orenx.Frame]:
    """A tour of the room at 30 Hz."""
    scene = Scene()
    return [scene.frame(p, i * 33_333_333, labels=labels) for i, p in enumerate(tour(count))]


def write_png(path: pathlib.Path, image: np.ndarray) -> None:
    """A grey image of 8 or 16 bits, or a color one."""
    image = np.asarray(image)
    bits, kind = 8 * image.dtype.itemsize, 2 if image.ndim == 3 else 0
    rows = image.astype(image.dtype.newbyteorder(">")).reshape(len(image), -1)
    body = b"".join(b"\0" + row.tobytes() for row in rows)

    def chunk(name: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        )

    head = struct.pack(">IIBBBBB", image.shape[1], image.shape[0], bits, kind, 0, 0, 0)
    parts = [chunk(b"IHDR", head), chunk(b"IDAT", zlib.compress(body, 6)), chunk(b"IEND", b"")]
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(parts))


def write_recording(folder: pathlib.Path, count: int) -> None:
    """A tour of the room, in the layout of 7-Scenes."""
    folder.mkdir(parents=True, exist_ok=True)
    np.savetxt(folder / "camera-intrinsics.txt", CAMERA.matrix)
    (folder / "labels.json").write_text(json.dumps({"classes": CLASSES}))
    scene = Scene()
    for number, pose in enumerate(tour(count)):
        stem = f"frame-{number:06d}"
        depth, ids = scene.look(pose)
        write_png(folder / f"{stem}.depth.png", np.round(depth * 1000).astype(np.uint16))
        write_png(folder / f"{stem}.color.png", COLORS[ids])
        write_png(folder / f"{stem}.label.png", ids)
        np.savetxt(folder / f"{stem}.pose.txt", pose)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--frames", type=int, default=60)
    options = parser.parse_args()
    write_recording(options.folder, options.frames)
    print(f"{options.frames} frames in {options.folder}")
