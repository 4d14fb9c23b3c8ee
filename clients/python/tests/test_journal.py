"""A journal: what a crash does not lose is told, and so is what it might."""

from __future__ import annotations

import pytest
import scene
from servers import start

import orenx
import orenx.aio

FRAMES = scene.frames(8)
SAFE = ["accepted", "durable", "integrated"]


@pytest.fixture
def journaled(tmp_path):
    """A server whose frames are journaled, and its folder."""
    folder = tmp_path / "maps"
    server = start(
        f"storage.path={folder}", "storage.journal=on", "storage.journal_mib=16", zenoh=True
    )
    yield server, folder
    server.stop()


def told(acks, seq):
    return [ack.status for ack in acks if ack.seq == seq]


def test_frames_are_durable_before_they_are_in_the_map(journaled):
    server, _ = journaled
    acks: list[orenx.Ack] = []
    with orenx.connect(server.grpc) as client:
        m = client.map()
        report = m.stream_frames(FRAMES, "rover", on_ack=acks.append)
        assert (report.integrated, report.durable, report.problems) == (8, 8, [])
        assert all(told(acks, seq) == SAFE for seq in range(8)), acks
        assert [ack.seq for ack in acks if ack.is_final] == list(range(8))
        stats = m.stats()
    assert stats.storage_problem == ""
    assert stats.storage.journal
    assert stats.storage.journal_frames == 8
    assert stats.storage.journal_bytes > 0


async def test_the_loop_hears_of_it_too(journaled):
    server, _ = journaled
    acks: list[orenx.Ack] = []
    async with await orenx.aio.connect(server.grpc) as client:
        report = await client.map().stream_frames(FRAMES, "rover", on_ack=acks.append)
    assert (report.integrated, report.durable) == (8, 8)
    assert all(told(acks, seq) == SAFE for seq in range(8)), acks


def test_zenoh_hears_of_it_too(journaled):
    pytest.importorskip("zenoh", reason="skipped: eclipse-zenoh is not installed")
    server, _ = journaled
    with orenx.connect(server.zenoh) as client:
        report = client.map().stream_frames(FRAMES, "rover")
    assert (report.integrated, report.durable, report.lost) == (8, 8, 0)


def test_a_frame_that_is_not_durable_says_why(journaled):
    server, folder = journaled
    # A file where the journal is to be: its folder is made with the first frame.
    (folder / "default").mkdir(parents=True, exist_ok=True)
    (folder / "default/journal").write_text("in the way")
    acks: list[orenx.Ack] = []
    with orenx.connect(server.grpc) as client:
        m = client.map()
        report = m.stream_frames(FRAMES[:1], "rover", on_ack=acks.append)
        assert (report.integrated, report.durable) == (1, 0)
        assert acks[-1].message.startswith("not durable: ")
        assert report.problems == [acks[-1].message]
        assert "not journaled" in m.stats().storage_problem
