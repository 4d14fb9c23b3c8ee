"""Maps are made, listed, emptied and deleted."""

from __future__ import annotations

import pytest
import scene

import orenx


def test_maps_come_and_go(client):
    yard = client.create_map("yard", {"r0_m": 0.2, "modalities": "sdf,occupancy"})
    try:
        assert yard.info().settings["r0_m"] == pytest.approx(0.2)
        assert {"default", "yard"} <= {summary.map_id for summary in client.maps()}
        with pytest.raises(orenx.FailedPreconditionError):
            client.create_map("yard")
        report = yard.stream_frames(scene.frames(2), "rover")
        assert report.integrated == 2
        assert yard.info().map.bounds is not None
        emptied = yard.reset()
        assert emptied.epoch > report.epoch
        assert yard.info().map.bounds is None
    finally:
        client.delete_map("yard")
    assert "yard" not in {summary.map_id for summary in client.maps()}
    with pytest.raises(orenx.NotFoundError):
        yard.info()


def test_operators_see_settings_and_change_the_log(client):
    assert "[server]" in client.settings()
    before = client.set_log_level("error")
    assert client.set_log_level(before) == "error"
    with pytest.raises(orenx.InvalidArgumentError) as caught:
        client.set_log_level("loud")
    assert caught.value.field == "level"
