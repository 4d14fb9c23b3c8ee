"""Maps as files: kept, fetched, sent to another server, and made the map again."""

from __future__ import annotations

import numpy as np
import pytest
import scene
from servers import start

import orenx
import orenx.aio

FRAMES = scene.frames(12)
POINTS = np.random.default_rng(5).uniform([-3, -2.5, -0.5], [3, 2.5, 3], (2000, 3))


@pytest.fixture(scope="module")
def keeping(tmp_path_factory):
    """A server with a folder."""
    folder = tmp_path_factory.mktemp("keeping")
    server = start(f"storage.path={folder}", zenoh=True)
    yield server
    server.stop()


@pytest.fixture
def m(keeping):
    """A map of it with a few frames, still fixed: its answers do not change by themselves."""
    with orenx.connect(keeping.grpc) as client:
        made = client.create_map("kept", {"schedule": "fixed", "steps": 0})
        made.stream_frames(FRAMES[:6], "rover")
        yield made
        client.delete_map("kept")


def test_a_map_becomes_what_it_was(m):
    made = m.create_snapshot("early")
    assert (made.name, made.frames, made.problem) == ("early", 6, "")
    assert made.bytes > 1000
    assert made.created_ns > 0
    before = m.query_points(POINTS)
    assert made.epoch == before.epoch
    later = m.stream_frames(FRAMES[6:], "rover")
    assert (m.query_points(POINTS, min_epoch=later.epoch).state != before.state).any()

    restored = m.restore_snapshot("early")
    assert restored.epoch > later.epoch
    assert restored.frames_dropped == 0
    after = m.query_points(POINTS, min_epoch=restored.epoch)
    np.testing.assert_array_equal(after.state, before.state)
    np.testing.assert_array_equal(after.distance, before.distance)
    assert m.stats().storage.saved_epoch == restored.epoch


def test_snapshots_are_listed_and_deleted(m):
    named = m.create_snapshot("one")
    unnamed = m.create_snapshot()
    assert unnamed.name
    assert m.list_snapshots() == sorted([named, unnamed], key=lambda s: s.name)
    assert m.delete_snapshot("one") is None
    assert m.list_snapshots() == [unnamed]
    for gone in (m.delete_snapshot, m.restore_snapshot):
        with pytest.raises(orenx.NotFoundError):
            gone("one")
    with pytest.raises(orenx.FailedPreconditionError):
        m.create_snapshot(unnamed.name)
    with pytest.raises(orenx.InvalidArgumentError) as caught:
        m.create_snapshot("No Name")
    assert caught.value.field == "name"


def test_a_snapshot_travels_to_another_server(m, tmp_path):
    made = m.create_snapshot("trip")
    file = tmp_path / "trip.orenx"
    file.write_text("what was there before")
    assert m.download_snapshot("trip", file) == file
    assert file.stat().st_size == made.bytes
    assert list(tmp_path.iterdir()) == [file]
    other = start(f"storage.path={tmp_path / 'other'}")
    try:
        with orenx.connect(other.grpc) as client:
            there = client.map()
            sent = there.upload_snapshot("came", str(file))
            assert (sent.name, sent.bytes, sent.frames) == ("came", made.bytes, 6)
            restored = there.restore_snapshot("came")
            answer = there.query_points(POINTS, min_epoch=restored.epoch)
    finally:
        other.stop()
    np.testing.assert_array_equal(answer.distance, m.query_points(POINTS).distance)


def test_what_is_no_snapshot_is_refused_and_leaves_nothing(m, tmp_path):
    kept = m.create_snapshot("whole")
    file = m.download_snapshot("whole", tmp_path / "whole.orenx")
    cut, large = tmp_path / "cut", tmp_path / "large"
    cut.write_bytes(file.read_bytes()[:-1])
    large.write_bytes(bytes(8 << 20))
    for wrong in (cut, large):
        with pytest.raises(orenx.InvalidArgumentError):
            m.upload_snapshot("wrong", wrong)
    with pytest.raises(FileNotFoundError):
        m.upload_snapshot("wrong", tmp_path / "absent")
    assert m.list_snapshots() == [kept]
    for name, path in (("absent", tmp_path / "new"), ("absent", file)):
        with pytest.raises(orenx.NotFoundError):
            m.download_snapshot(name, path)
    assert file.stat().st_size == kept.bytes
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cut", "large", "whole.orenx"]


async def test_the_loop_keeps_maps_too(keeping, m, tmp_path):
    async with await orenx.aio.connect(keeping.grpc) as client:
        same = client.map(m.map_id)
        made = await same.create_snapshot("loop")
        file = await same.download_snapshot("loop", tmp_path / "loop.orenx")
        assert file.stat().st_size == made.bytes
        sent = await same.upload_snapshot("again", file)
        assert sent.bytes == made.bytes
        assert [s.name for s in await same.list_snapshots()] == ["again", "loop"]
        await same.delete_snapshot("loop")
        assert (await same.restore_snapshot("again")).epoch > made.epoch
        with pytest.raises(orenx.NotFoundError):
            await same.download_snapshot("loop", file)
        file.write_bytes(bytes(8 << 20))
        with pytest.raises(orenx.InvalidArgumentError):
            await same.upload_snapshot("wrong", file)
        assert list(tmp_path.iterdir()) == [file]


def test_where_nothing_is_kept_it_is_said(server, keeping, tmp_path):
    with orenx.connect(server.grpc) as client, pytest.raises(orenx.FailedPreconditionError):
        client.map().create_snapshot()
    pytest.importorskip("zenoh", reason="skipped: eclipse-zenoh is not installed")
    with orenx.connect(keeping.zenoh) as client:
        m = client.map()
        file = tmp_path / "file"
        for ask in (m.list_snapshots, lambda: m.download_snapshot("one", file)):
            with pytest.raises(orenx.Error) as caught:
                ask()
            assert caught.value.code == "UNIMPLEMENTED"
        assert not file.exists()
