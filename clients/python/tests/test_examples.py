"""The examples run, against the real server, and do what they say."""

from __future__ import annotations

import os
import pathlib
import subprocess
import sys

import label_frames
import numpy as np
import plan_path
import pytest
import scene
from servers import ROOT, needs_encoder, start

import orenx

EXAMPLES = ROOT / "clients/python/examples"
START, GOAL = np.array([1.2, 1.2, 0.5]), np.array([-1.2, -1.5, 0.5])


def run(name: str, *args: object) -> str:
    env = {**os.environ, "PYTHONPATH": str(ROOT / "clients/python/src")}
    command = [sys.executable, str(EXAMPLES / name), *map(str, args)]
    done = subprocess.run(command, check=False, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> pathlib.Path:
    folder = tmp_path_factory.mktemp("recording") / "room"
    run("scene.py", folder, "--frames", 16)
    return folder


def test_a_recording_is_streamed(recording, client, server):
    client.create_map("streamed")
    try:
        said = run("stream_recording.py", recording, server.grpc, "--map", "streamed")
        assert said.startswith("16 of 16 frames"), said
    finally:
        client.delete_map("streamed")


def test_a_path_is_planned_around_the_table(room):
    with orenx.connect(room.grpc) as client:
        m = client.map("default")
        straight = np.linspace(START, GOAL, 12)
        poses = np.concatenate([straight, np.tile([0.0, 0, 0, 1], (12, 1))], axis=1)
        assert (
            m.check_trajectories(plan_path.ROBOT, [poses], swept=True).trajectories[0].first_hit
            is not None
        )
        path, verdicts = plan_path.plan(m, START, GOAL)
    assert verdicts.safe.any()
    np.testing.assert_allclose(path[[0, -1]], [START, GOAL], atol=1e-6)
    fine = np.concatenate([np.linspace(a, b, 20) for a, b in zip(path, path[1:])])
    centers = (fine[:, None] + plan_path.ROBOT[:, :3]).reshape(-1, 3)
    # By the room's own truth, not only by the map.
    assert scene.Scene().distance(centers).min() > 0.1 - 0.02
    said = run("plan_path.py", "--url", room.grpc, "--start=1.2,1.2,0.5", "--goal=-1.2,-1.5,0.5")
    assert "candidates are safe" in said


def test_geometry_tells_floor_and_walls_apart():
    frame = scene.frames(8)[3]
    _, truth = scene.Scene().look(np.asarray(frame.pose))
    ids = label_frames.segment(frame)
    for id_ in (1, 2):
        claimed = ids == id_
        assert claimed.mean() > 0.05
        right = (truth[claimed] == id_) | (
            (id_ == 2) & (truth[claimed] >= 4)
        )  # sides of things stand upright too
        assert right.mean() > 0.9, (id_, right.mean())
    tops = np.isin(truth[ids == 4], [4, 5, 6])
    assert tops.mean() > 0.9


def test_a_png_is_read_as_it_was_written(tmp_path):
    depth = np.random.default_rng(0).integers(0, 65536, (7, 9)).astype(np.uint16)
    scene.write_png(tmp_path / "d.png", depth)
    np.testing.assert_array_equal(label_frames.read_png16((tmp_path / "d.png").read_bytes()), depth)


def test_labelled_frames_can_be_asked_for(recording, client, server):
    needs_encoder()
    client.create_map("geometry")
    try:
        said = run("label_frames.py", recording, "floor", "--url", server.grpc, "--map", "geometry")
        assert said.startswith("16 of 16"), said
        best = client.map("geometry").ask("floor").best
        assert abs(best.centroid[2]) < 0.15, best
    finally:
        client.delete_map("geometry")


def test_the_notebook_runs(server, tmp_path):
    nbclient = pytest.importorskip("nbclient", reason="skipped: nbclient is not installed")
    nbformat = pytest.importorskip("nbformat", reason="skipped: nbformat is not installed")
    pytest.importorskip("ipykernel", reason="skipped: ipykernel is not installed")
    pytest.importorskip("matplotlib", reason="skipped: matplotlib is not installed")
    notebook = nbformat.read(EXAMPLES / "tour.ipynb", as_version=4)
    assert all(not cell.get("outputs") for cell in notebook.cells), "commit it without outputs"
    paths = [str(ROOT / "clients/python/src"), str(EXAMPLES)]
    env = {
        **os.environ,
        "ORENX_URL": server.grpc,
        "PYTHONPATH": os.pathsep.join(paths),
        "MPLBACKEND": "agg",
        "IPYTHONDIR": str(tmp_path),
    }
    running = nbclient.NotebookClient(notebook, timeout=60, kernel_name="python3", resources={})
    running.execute(env=env)
    (judged,) = (cell for cell in notebook.cells if "error_mm" in cell.source)
    results = [output for output in judged.outputs if output.output_type == "execute_result"]
    error = results[0]["data"]["text/plain"]
    assert float(error) < 20, error


def test_a_map_is_shown_in_rerun(room, tmp_path):
    rerun = pytest.importorskip("rerun", reason="skipped: rerun-sdk is not installed")
    from orenx import viewer

    with orenx.connect(room.grpc) as client:
        m = client.map("default")
        points, colors = viewer.surface(m, m.info().map.bounds)
        assert len(points) > 1000
        assert np.median(np.abs(scene.Scene().distance(points))) < 0.02
        assert colors.min() >= 0
        recording = rerun.RecordingStream("orenx-test")
        recording.save(str(tmp_path / "map.rrd"))
        assert viewer.log(m, slice_z_m=1.0, recording=recording) > 1000
        recording.flush()
        del recording
    assert (tmp_path / "map.rrd").stat().st_size > 10_000
    run("show_in_rerun.py", room.grpc, "--once", "--save", tmp_path / "two.rrd")
    assert (tmp_path / "two.rrd").stat().st_size > 10_000


def test_the_readme_s_first_lines_work():
    text = (ROOT / "clients/python/README.md").read_text()
    code = text.split("```python\n")[1].split("```")[0]
    server = start()
    try:
        code = code.replace("grpc://127.0.0.1:7610", server.grpc)
        namespace: dict[str, object] = {}
        exec(code, namespace)
        assert namespace["stream"].report.integrated == 1
        namespace["client"].close()
    finally:
        server.stop()
