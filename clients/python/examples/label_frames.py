"""Labels the frames of a recording while they are sent, and asks the map for what they show.

    python label_frames.py room "somewhere to sit"

The segmenter here is geometry: normals of the depth image and heights above the floor tell floor, wall,
ceiling and furniture apart. It is a real one, if a simple one; yours takes its place in `segment`. A
recording with labels.json and frame-*.label.png brings its own labels: stream_recording.py --labels.
The server needs a text encoder: orenx serve --set encoder.kind=static --set encoder.folder=FOLDER.
"""

from __future__ import annotations

import argparse
import dataclasses
import struct
import zlib
from collections.abc import Iterable, Iterator

import numpy as np

import orenx
from orenx import recordings

CLASSES = {1: "floor", 2: "wall", 3: "ceiling", 4: "furniture"}


def metres(frame: orenx.Frame) -> np.ndarray:
    """The depth of a frame, decoded."""
    depth = frame.depth
    if isinstance(depth, bytes):
        depth = read_png16(depth)
    if depth.dtype.kind == "u":
        raw = depth.astype(np.float32)
        return np.where((raw == 0) | (raw == 65535), np.nan, raw / frame.units_per_metre)
    return np.where(depth > 0, depth, np.nan)


def segment(frame: orenx.Frame, floor_z: float = 0.0) -> np.ndarray:
    """The class of each pixel: 0 where the geometry does not tell."""
    depth, camera = metres(frame), frame.intrinsics
    pose = np.asarray(frame.pose, np.float64)
    v, u = np.mgrid[: camera.height, : camera.width]
    rays = np.stack(
        [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)], axis=-1
    )
    points = (rays * depth[..., None]) @ pose[:3, :3].T + pose[:3, 3]
    # A normal from neighbours a few pixels away, which noise tilts less.
    step = max(2, camera.width // 80)
    across = np.roll(points, -step, 1) - np.roll(points, step, 1)
    down = np.roll(points, -step, 0) - np.roll(points, step, 0)
    normal = np.cross(down, across)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = np.divide(normal, length, out=np.full_like(normal, np.nan), where=length > 1e-9)
    height, up = points[..., 2] - floor_z, normal[..., 2]
    ids = np.zeros(depth.shape, np.uint8)
    with np.errstate(invalid="ignore"):
        top = np.nanpercentile(height, 98) if np.isfinite(height).any() else 0.0
        ids[(np.abs(up) < 0.4) & (height > 0.1)] = 2
        ids[(np.abs(up) > 0.9) & (np.abs(height) < 0.1)] = 1
        ids[(np.abs(up) > 0.9) & (height > max(2.0, top - 0.15))] = 3
        ids[(np.abs(up) > 0.9) & (height > 0.25) & (height < 1.2)] = 4
    ids[~np.isfinite(depth)] = 0
    return ids


def labelled(frames: Iterable[orenx.Frame], floor_z: float = 0.0) -> Iterator[orenx.Frame]:
    """The same frames with their classes."""
    for frame in frames:
        yield dataclasses.replace(frame, labels=orenx.Labels(segment(frame, floor_z), CLASSES))


def read_png16(data: bytes) -> np.ndarray:
    """A 16-bit grey PNG without interlacing, as depth cameras' are; any image library does it too."""
    at, body, size = 8, b"", (0, 0)
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        chunk = data[at + 8 : at + 8 + length]
        if kind == b"IHDR":
            width, height, bits, color, _, _, interlaced = struct.unpack(">IIBBBBB", chunk)
            if (bits, color, interlaced) != (16, 0, 0):
                raise ValueError("not a 16-bit grey PNG")
            size = (height, width)
        elif kind == b"IDAT":
            body += chunk
        at += 12 + length
    rows = np.frombuffer(zlib.decompress(body), np.uint8).reshape(size[0], 1 + 2 * size[1])
    image = np.zeros((size[0], 2 * size[1]), np.uint8)
    above = np.zeros(2 * size[1], np.uint8)
    for y, (kind, row) in enumerate(zip(rows[:, 0], rows[:, 1:])):
        image[y] = above = unfilter(int(kind), row, above)
    return image.view(">u2").astype(np.uint16)


def unfilter(kind: int, row: np.ndarray, above: np.ndarray) -> np.ndarray:
    """One row of a PNG of two bytes a pixel."""
    if kind == 0:
        return row
    if kind == 2:
        return row + above
    if kind == 1:
        return np.cumsum(row.reshape(-1, 2), axis=0, dtype=np.uint8).ravel()
    out = np.zeros(len(row) + 2, np.int32)
    up = np.concatenate([[0, 0], above.astype(np.int32)])
    for x in range(2, len(out)):
        left, top, corner = out[x - 2], up[x], up[x - 2]
        if kind == 3:
            guess = (left + top) // 2
        else:
            p = left + top - corner
            guess = min((left, top, corner), key=lambda near: abs(p - near))
        out[x] = (int(row[x - 2]) + guess) & 255
    return out[2:].astype(np.uint8)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder")
    parser.add_argument("question", nargs="?", default="furniture")
    parser.add_argument("--url", default="grpc://127.0.0.1:7610")
    parser.add_argument("--map", default="default")
    parser.add_argument(
        "--floor", type=float, default=0.0, help="height of the floor in the recording's world, m"
    )
    parser.add_argument("--stride", type=int, default=1)
    o = parser.parse_args()
    with orenx.connect(o.url) as client:
        m = client.map(o.map)
        report = m.stream_frames(
            labelled(recordings.frames(o.folder, stride=o.stride), o.floor), "labeller"
        )
        print(f"{report.integrated} of {report.frames} frames in the map", *report.problems)
        for match in m.ask(o.question, top_k=3).matches:
            print(
                f"{match.score:.2f} at {np.round(match.centroid, 2)}, {np.round(match.extent, 2)} m"
            )
