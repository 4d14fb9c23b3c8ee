"""The client for asyncio: the same answers, many questions at a time, streams and watches."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest
import scene
from servers import PATIENCE_S, start

import orenx
import orenx.aio

FRAMES = scene.frames(8)


@pytest.fixture(params=["grpc", "zenoh"])
async def default(request, room):
    if request.param == "zenoh":
        pytest.importorskip("zenoh", reason="skipped: eclipse-zenoh is not installed")
    async with await orenx.aio.connect(getattr(room, request.param)) as client:
        yield client.map("default")


async def test_answers_are_those_of_the_other_client(default, room):
    points = np.random.default_rng(2).uniform(-2, 2, (100, 3))
    answers = await asyncio.gather(*(default.query_points(points) for _ in range(8)))
    with orenx.connect(room.grpc) as client:
        expected = client.map("default").query_points(points)
    for answer in answers:
        np.testing.assert_array_equal(answer.state, expected.state)
        np.testing.assert_array_equal(answer.distance, expected.distance)
    assert (await default.slice(1.0)).distance.ndim == 2
    assert (await default.info()).map.map_id == "default"


async def test_errors_are_those_of_the_other_client(default):
    with pytest.raises(orenx.InvalidArgumentError) as caught:
        await default.query_points([[np.inf, 0, 0]])
    assert caught.value.field == "points_m[0].x"
    with pytest.raises(orenx.InvalidArgumentError):
        await default.query_points([[1, 2]])


async def test_frames_of_any_iterable_get_their_last_words(server):
    async def later():
        for frame in FRAMES:
            await asyncio.sleep(0)
            yield frame

    async with await orenx.aio.connect(server.grpc) as client:
        m = await client.create_map("aio")
        try:
            assert (await m.stream_frames(FRAMES, "a")).integrated == 8
            assert (await m.stream_frames(later(), "b")).integrated == 8
            final = [ack async for ack in m.stream_acks(later(), "c") if ack.is_final]
            assert [ack.status for ack in final] == ["integrated"] * 8
            async with await m.open_stream("d", policy="latest") as stream:
                for frame in FRAMES * 3:
                    await stream.send(frame)
            report = stream.report
            assert report.integrated + sum(report.dropped.values()) == 24
            assert "aio" in {summary.map_id for summary in await client.maps()}
        finally:
            await client.delete_map("aio")


async def test_frames_over_zenoh_get_theirs_too(server):
    pytest.importorskip("zenoh", reason="skipped: eclipse-zenoh is not installed")
    async with await orenx.aio.connect(server.zenoh) as client:
        report = await client.map().stream_frames(FRAMES, "aio-zenoh")
    assert (report.integrated, report.lost) == (8, 0)


async def test_a_watch_says_what_changes(server):
    async with await orenx.aio.connect(server.grpc) as client:
        m = await client.create_map("watched")
        try:
            updates = m.watch_region([[-2, -1, 0], [2, 1, 2]], 0.1)
            first = await asyncio.wait_for(updates.__anext__(), PATIENCE_S)
            assert first.bricks == []
            sending = asyncio.create_task(m.stream_frames(FRAMES, "a"))
            second = await asyncio.wait_for(updates.__anext__(), PATIENCE_S)
            assert second.bricks
            assert second.epoch > first.epoch
            await sending
            await updates.aclose()
        finally:
            await client.delete_map("watched")


async def test_a_watch_is_had_over_either_transport(default):
    updates = default.watch_region([[-2, -1, 0], [2, 1, 2]], 0.2)
    first = await asyncio.wait_for(updates.__anext__(), PATIENCE_S)
    assert first.bricks
    await updates.aclose()


async def test_nobody_there_is_said_within_the_time_given():
    with pytest.raises(orenx.UnavailableError):
        await orenx.aio.connect("grpc://127.0.0.1:1", wait_s=0.3)


async def test_a_server_that_goes_away_ends_the_stream():
    server = start()
    async with await orenx.aio.connect(server.grpc) as client:
        stream = await client.map().open_stream("rover", policy="block")
        await stream.send(FRAMES[0])
        await asyncio.to_thread(server.stop)
        with pytest.raises(orenx.UnavailableError):  # noqa: PT012 (any of them may tell)
            for frame in FRAMES * 100:
                await stream.send(frame, timeout_s=PATIENCE_S)
        await stream.cancel()
