"""Watches over gRPC, from threads."""

from __future__ import annotations

import numpy as np
import pytest
import scene

import orenx

BOX = [[-2.5, -2.0, 0.0], [2.5, 2.0, 2.4]]


def test_a_region_that_is_kept_up_is_what_a_grid_says(client):
    m = client.create_map("kept")
    try:
        epoch = m.stream_frames(scene.frames(3), "rover").epoch
        with m.watch_region(BOX, 0.1) as updates:
            distance = state = None
            for update in updates:
                if distance is None:
                    distance = np.full(update.shape, np.nan, np.float32)
                    state = np.zeros(update.shape, np.uint8)
                update.write_to(distance, state)
                if update.epoch >= epoch:
                    break
            grid = m.grid(BOX, 0.1)
            while update.epoch < grid.epoch:
                update = next(updates)
                update.write_to(distance, state)
        if update.epoch == grid.epoch:
            np.testing.assert_array_equal(state, grid["state"])
            np.testing.assert_allclose(distance, grid["distance"], atol=1e-5)
        assert (state == 1).any()
        assert (state == 2).any()
    finally:
        client.delete_map("kept")


def test_a_path_that_becomes_unsafe_is_told(client):
    m = client.create_map("paths")
    try:
        through = np.array([[1.2, 1.2, 0.5, 0, 0, 0, 1], [0.0, -0.3, 0.5, 0, 0, 0, 1]])
        with m.watch_trajectory([[0, 0, 0, 0.2]], through, swept=True) as verdicts:
            assert next(verdicts).trajectories[0].first_hit is None
            m.stream_frames(scene.frames(12), "rover")
            for answer in verdicts:
                if answer.trajectories[0].first_hit is not None:
                    break
            assert not answer.safe[0]
    finally:
        client.delete_map("paths")


def test_a_watch_that_is_closed_ends(default):
    updates = default.watch_region(BOX, 0.2)
    first = next(updates)
    assert first.bricks
    updates.close()
    assert list(updates) == []


def test_a_watch_over_zenoh_tells_what_comes(server):
    pytest.importorskip("zenoh", reason="skipped: eclipse-zenoh is not installed")
    with orenx.connect(server.zenoh) as over_zenoh:
        m = over_zenoh.map("default")
        path = np.array([[1.2, 1.2, 0.5, 0, 0, 0, 1], [0.0, -0.3, 0.5, 0, 0, 0, 1]])
        with m.watch_trajectory([[0, 0, 0, 0.2]], path, swept=True) as verdicts:
            assert len(next(verdicts).trajectories) == 1
        with m.watch_region(BOX, 0.1) as updates:
            first = next(updates)
            report = m.stream_frames(scene.frames(6), "watched")
            last = first
            while last.epoch < report.epoch:
                last = next(updates)
        with pytest.raises(orenx.InvalidArgumentError):
            m.watch_region(BOX, 0.0)
