"""Frames: every one gets a last word, and the bounds hold."""

from __future__ import annotations

import threading

import numpy as np
import pytest
import scene
from servers import PATIENCE_S, start

import orenx
from orenx.books import Books
from orenx.frames import Ack, read_ack
from orenx.v1 import ingest_pb2

FRAMES = scene.frames(12)


@pytest.fixture
def own(client, request):
    """A map for one test."""
    name = f"t{abs(hash(request.node.name)) % 10**9}"
    yield client.create_map(name)
    client.delete_map(name)


def test_a_recording_loses_nothing(own):
    acks: list[Ack] = []
    report = own.stream_frames(FRAMES, "rover", on_ack=acks.append)
    assert (report.frames, report.integrated, report.dropped, report.rejected) == (12, 12, {}, {})
    assert report.epoch == max(ack.epoch for ack in acks)
    assert report.visible_after_ms[0] > 0
    assert own.query_points([[0, 1, 1]], min_epoch=report.epoch).epoch >= report.epoch
    final = [ack.seq for ack in acks if ack.is_final]
    assert final == list(range(12))


def test_acks_come_as_frames_are_taken(own):
    taken = 0

    def frames():
        nonlocal taken
        for frame in FRAMES:
            taken += 1
            yield frame

    final = [ack for ack in own.stream_acks(frames(), "rover", window=2) if ack.is_final]
    assert [ack.status for ack in final] == ["integrated"] * 12
    assert taken == 12
    some = own.stream_acks(frames(), "rover", window=1, buffer=1)
    next(some)
    taken_then = taken - 12
    some.close()
    assert taken_then < 12


def test_a_live_robot_never_waits_and_every_frame_has_a_last_word(own):
    told: list[Ack] = []
    with own.open_stream("rover", policy="latest", on_ack=told.append) as stream:
        for _ in range(4):
            for frame in FRAMES:
                stream.send(frame)
    report = stream.report
    assert report.frames == 48
    assert report.integrated + sum(report.dropped.values()) == 48
    assert report.integrated >= 1
    assert set(report.dropped) <= {"replaced_here", "replaced"}
    assert sorted(ack.seq for ack in told if ack.is_final) == list(range(48))


def test_a_refused_frame_says_why_and_the_stream_goes_on(own):
    good = FRAMES[0]
    wrong = orenx.Frame(
        good.depth, good.pose, good.intrinsics, color=b"\xff\xd8 no image", stamp_ns=1
    )
    report = own.stream_frames([good, wrong, FRAMES[1]], "rover")
    assert report.integrated == 2
    assert sum(report.rejected.values()) == 1
    assert any("color" in problem for problem in report.problems), report


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"depth": np.zeros((2, 2), np.float32)}, "depth"),
        ({"depth": np.zeros((120, 160), np.int64)}, "depth"),
        ({"color": np.zeros((120, 160, 3), np.float32)}, "color"),
        ({"color": b"GIF89a"}, "color"),
        ({"pose": np.eye(3)}, "pose"),
        ({"pose": 2 * np.eye(4)}, "pose"),
        ({"labels": orenx.Labels(np.zeros((120, 160)), {})}, "labels"),
    ],
)
def test_a_frame_that_is_none_is_refused_before_it_is_sent(own, change, field):
    good = FRAMES[0]
    given = {"depth": good.depth, "pose": good.pose, "intrinsics": good.intrinsics, **change}
    with own.open_stream("rover") as stream:
        with pytest.raises(orenx.InvalidArgumentError) as caught:
            stream.send(orenx.Frame(**given))
        stream.send(good)
    assert caught.value.field == field
    assert stream.report.integrated == 1


@pytest.mark.parametrize("kind", ["mm", "png"])
def test_depth_in_millimetres_and_as_png_maps_the_same(own, kind, tmp_path):
    def as_kind(frame):
        depth = np.round(frame.depth * 1000).astype(np.uint16)
        if kind == "png":
            scene.write_png(tmp_path / "d.png", depth)
            scene.write_png(tmp_path / "c.png", frame.color)
            depth, color = (tmp_path / "d.png").read_bytes(), (tmp_path / "c.png").read_bytes()
        else:
            color = frame.color
        return orenx.Frame(
            depth, frame.pose, frame.intrinsics, color=color, stamp_ns=frame.stamp_ns
        )

    assert own.stream_frames(map(as_kind, FRAMES), "rover").integrated == 12
    point = np.array([[0.0, 1.0, 1.2]])
    assert own.query_points(point).distance[0] == pytest.approx(
        scene.Scene().distance(point)[0], abs=0.03
    )


def test_features_with_an_index_are_asked_for_by_embedding():
    encoder, dimension = "test/vectors", 8
    vectors = np.eye(dimension, dtype=np.float32)

    def with_features(frame):
        ids = scene.Scene().look(frame.pose)[1]
        features = orenx.Features(encoder, vectors[:7], index=ids.astype(np.uint16))
        return orenx.Frame(
            frame.depth, frame.pose, frame.intrinsics, stamp_ns=frame.stamp_ns, features=features
        )

    server = start(
        "encoder.kind=external", f"encoder.id={encoder}", f"encoder.dimension={dimension}"
    )
    try:
        with orenx.connect(server.grpc) as client:
            m = client.map("default")
            assert m.stream_frames(map(with_features, FRAMES), "rover").integrated == 12
            found = m.ask_embedding(encoder, vectors[5], negatives=vectors[[1, 2, 3]]).best
            with pytest.raises(orenx.FailedPreconditionError):
                m.ask_embedding("another", vectors[5])
    finally:
        server.stop()
    assert found is not None
    assert np.abs(found.centroid - [-1.95, -0.2, 0.5]).max() < 0.6, found


def test_a_server_that_goes_away_ends_the_stream():
    server = start()
    with orenx.connect(server.grpc) as client:
        stream = client.map("default").open_stream("rover", policy="block")
        stream.send(FRAMES[0])
        server.stop()
        with pytest.raises(orenx.Error):  # noqa: PT012 (any of them may be the one that tells)
            for frame in FRAMES * 100:
                stream.send(frame, timeout_s=PATIENCE_S)
        stream.cancel()


def test_an_exception_in_the_callback_comes_back_to_the_sender(own):
    def fail(ack):
        raise RuntimeError("no")

    stream = own.open_stream("rover", policy="block", on_ack=fail)
    with pytest.raises(RuntimeError, match="no"):  # noqa: PT012
        for frame in FRAMES * 10:
            stream.send(frame, timeout_s=PATIENCE_S)
    stream.cancel()


def test_over_zenoh_frames_get_their_last_words_too(server, client):
    pytest.importorskip("zenoh", reason="skipped: eclipse-zenoh is not installed")
    with orenx.connect(server.zenoh) as over_zenoh:
        acks: list[Ack] = []
        m = over_zenoh.map("default")
        before = m.stats().counts.integrated
        report = m.stream_frames(FRAMES, "zenoh-rover", "front", on_ack=acks.append)
        assert (report.frames, report.integrated, report.lost) == (12, 12, 0), report
        assert m.stats().counts.integrated - before == 12
        with pytest.raises(orenx.Error) as caught:
            m.reset()
        assert caught.value.code == "UNIMPLEMENTED"


def test_books_give_way_hold_the_window_and_find_what_was_lost():
    books = Books("m", "r", "s", "latest", buffer=2, window=3)
    gone = [ack.seq for i in range(4) for ack in books.add(b"")]
    assert gone == [0, 1]
    assert [books.take()[0] for _ in range(2)] == [2, 3]
    books.add(b"")
    assert books.may_send()
    books.take()
    books.add(b"")
    assert not books.may_send()
    assert [ack.seq for ack in books.lost(before=3)] == [2]
    assert books.may_send()
    assert [ack.status for ack in books.overdue(0.0)] == ["lost", "lost"]
    assert books.report().dropped == {"replaced_here": 2}
    assert books.report().lost == 3


def test_a_sender_that_blocks_waits_for_room():
    books = Books("m", "r", "s", "block", buffer=1, window=1)
    taken = threading.Event()
    stream = orenx.FrameStream(books, lambda _: taken.set, None, None)
    stream.send(FRAMES[0])
    with pytest.raises(orenx.DeadlineExceededError):
        stream.send(FRAMES[1], timeout_s=0.01)
    stream.cancel()
    assert taken.is_set()


def test_books_count_durable_frames_and_wait_for_their_last_word():
    books = Books("m", "r", "s", "block", buffer=2, window=2)

    def hear(seq, status, message=""):
        ack = ingest_pb2.FrameAck(robot_id="r", sensor_id="s", seq=seq, message=message)
        ack.status = ingest_pb2.FrameStatus.Value(f"FRAME_STATUS_{status}")
        return books.settle(read_ack(ack))

    for _ in range(2):
        books.add(b"")
        books.take()
    books.is_closed = True
    assert hear(0, "ACCEPTED")
    assert hear(0, "DURABLE")
    assert not books.is_done()
    assert hear(0, "INTEGRATED")
    assert hear(1, "INTEGRATED", "not durable: the disk is full")
    assert books.is_done()
    report = books.report()
    assert (report.integrated, report.durable) == (2, 1)
    assert report.problems == ["not durable: the disk is full"]
