"""Folders of recorded frames: written here, and the real one that ORENX_TEST_DATA has."""

from __future__ import annotations

import os
import pathlib

import numpy as np
import pytest
import scene
from servers import needs_encoder

import orenx
from orenx import recordings


def test_a_folder_of_7_scenes_maps_the_room(tmp_path, client):
    scene.write_recording(tmp_path / "room", 10)
    found = list(recordings.frames(tmp_path / "room", stride=2))
    assert len(found) == 5
    assert found[1].stamp_ns == 2 * 33_333_333
    assert found[0].intrinsics.width == 160
    m = client.create_map("seven")
    try:
        assert m.stream_frames(recordings.frames(tmp_path / "room"), "rover").integrated == 10
        point = np.array([[0.0, 1.0, 1.2]])
        off = m.query_points(point).distance[0] - scene.Scene().distance(point)[0]
        assert abs(off) < 0.03
    finally:
        client.delete_map("seven")


def test_labels_of_a_folder_can_be_asked_for(tmp_path, client):
    needs_encoder()
    scene.write_recording(tmp_path / "room", 12)
    m = client.create_map("labelled")
    try:
        frames = recordings.frames(tmp_path / "room", labels=True)
        assert m.stream_frames(frames, "rover").integrated == 12
        assert m.ask("sofa").best is not None
    finally:
        client.delete_map("labelled")


def test_a_folder_of_tum_has_poses_between_its_poses(tmp_path, client):
    folder = tmp_path / "rgbd_dataset_freiburg1_room"
    folder.mkdir()
    poses = scene.tour(6)
    flat = orenx.geometry.poses_flat("poses", np.stack(poses))
    depth, truth = ["# depth"], ["# truth"]
    for at, pose in enumerate(poses[:4]):
        stamp = 100 + at / 30
        metres, _ = scene.Scene().look(pose)
        scene.write_png(folder / f"{at}.png", np.round(metres * 5000).astype(np.uint16))
        depth.append(f"{stamp:.6f} {at}.png")
        if at != 2:  # one without a pose near it
            around = [(stamp + apart, *flat[at]) for apart in (-0.01, 0.01)]
            truth += [" ".join(f"{n:.6f}" for n in line) for line in around]
    (folder / "depth.txt").write_text("\n".join(depth))
    (folder / "groundtruth.txt").write_text("\n".join(truth))
    np.savetxt(folder / "camera-intrinsics.txt", scene.CAMERA.matrix)
    found = list(recordings.frames(folder))
    assert len(found) == 3
    assert found[0].units_per_metre == 5000
    np.testing.assert_allclose(found[1].pose, flat[1], atol=1e-5)
    m = client.create_map("tum")
    try:
        assert m.stream_frames(found, "rover").integrated == 3
    finally:
        client.delete_map("tum")


def test_the_recorded_kitchen(client):
    folder = pathlib.Path(os.environ.get("ORENX_TEST_DATA", "")) / "kitchen"
    if "ORENX_TEST_DATA" not in os.environ or not folder.is_dir():
        pytest.skip("skipped: no kitchen in ORENX_TEST_DATA")
    m = client.create_map("kitchen")
    try:
        report = m.stream_frames(recordings.frames(folder, stride=8), "kinect")
        assert report.integrated == report.frames > 10, report
        # The first camera stood in free space.
        pose = next(recordings.frames(folder)).pose
        ahead = pose @ [0, 0, 0.5, 1]
        assert m.query_points(ahead[:3]).free[0]
    finally:
        client.delete_map("kitchen")


def test_what_is_no_recording_is_said(tmp_path):
    with pytest.raises(orenx.NotFoundError):
        recordings.frames(tmp_path / "none")
    with pytest.raises(orenx.InvalidArgumentError, match="depth"):
        recordings.frames(tmp_path)
