"""A map in the viewer rerun (https://rerun.io): surface, slice, robots. Needs the extra `orenx[rerun]`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .client import Map
from .geometry import Box
from .types import F32

# The server's bound of one grid, voxels.
_MOST_VOXELS = 4_000_000


def surface(m: Map, region: Box | ArrayLike, voxel_m: float = 0.05) -> tuple[F32, F32]:
    """Points of the surface within a box, and their colors in 0..1 (grey where none was seen).

    They are centers of voxels near the surface, moved onto it along the gradient.
    """
    low, high = np.asarray(list(region) if isinstance(region, Box) else region, np.float64)
    cells = np.maximum(np.ceil((high - low) / voxel_m), 1)
    voxel_m = voxel_m * max(1.0, float((cells.prod() / _MOST_VOXELS) ** (1 / 3)))
    grid = m.grid([low, high], voxel_m, fields=["distance", "state"])
    near = np.abs(grid["distance"]) < 0.9 * voxel_m  # false for NaN
    centers = grid.centers[near]
    if not len(centers):
        return np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32)
    at = m.query_points(centers, fields=["distance", "gradient"])
    assert at.distance is not None
    assert at.gradient is not None
    steep = np.linalg.norm(at.gradient, axis=1, keepdims=True)
    towards = np.divide(at.gradient, steep, out=np.zeros_like(at.gradient), where=steep > 0.1)
    points = (centers - at.distance[:, None] * towards).astype(np.float32)
    points = points[np.isfinite(points).all(axis=1)]
    colors = m.query_points(points, fields=["color"]).color
    if colors is None:
        colors = np.full_like(points, np.nan)
    return points, np.where(np.isfinite(colors), colors, np.float32(0.6))


def log(
    m: Map,
    *,
    entity: str = "orenx",
    voxel_m: float = 0.05,
    slice_z_m: float | None = None,
    recording: Any = None,
) -> int:
    """Logs the surface, a slice and the robots' cameras at the map's epoch; returns how many points.

    `rerun.init` comes before, with whatever sink is wanted; `recording` is one of several recordings.
    """
    import rerun as rr

    stats = m.stats()
    rr.set_time("epoch", sequence=stats.epoch, recording=recording)
    rr.log(entity, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True, recording=recording)
    if stats.map.bounds is None:
        return 0
    points, colors = surface(m, stats.map.bounds, voxel_m)
    cloud = rr.Points3D(points, colors=(colors * 255).astype(np.uint8), radii=voxel_m / 3)
    rr.log(f"{entity}/surface", cloud, recording=recording)
    if slice_z_m is not None:
        _log_slice(rr, m, entity, slice_z_m, voxel_m, recording)
    for robot in stats.robots:
        if robot.world_from_camera is None or robot.intrinsics is None:
            continue
        name, pose, camera = (
            f"{entity}/robots/{robot.robot_id}",
            robot.world_from_camera,
            robot.intrinsics,
        )
        stands = rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3])
        rr.log(name, stands, recording=recording)
        sees = rr.Pinhole(
            image_from_camera=camera.matrix,
            resolution=[camera.width, camera.height],
            camera_xyz=rr.ViewCoordinates.RDF,
        )
        rr.log(f"{name}/camera", sees, recording=recording)
    return len(points)


def _log_slice(rr: Any, m: Map, entity: str, z_m: float, voxel_m: float, recording: Any) -> None:
    answer = m.slice(z_m, resolution_m=max(voxel_m, 0.02))
    assert answer.distance is not None
    places = np.argwhere(np.isfinite(answer.distance))
    distance = answer.distance[tuple(places.T)]
    centers = np.empty((len(places), 3), np.float32)
    centers[:, :2] = answer.origin[:2] + (places + 0.5) * answer.resolution_m
    centers[:, 2] = z_m
    # Red at obstacles, blue a metre away from them.
    share = np.clip(distance, 0, 1)
    colors = np.stack([255 * (1 - share), 60 + 0 * share, 255 * share], axis=1).astype(np.uint8)
    rr.log(
        f"{entity}/slice",
        rr.Points3D(centers, colors=colors, radii=answer.resolution_m / 2),
        recording=recording,
    )
