"""A real server for the tests."""

from __future__ import annotations

import pytest
import scene
from servers import encoder, start

import orenx


@pytest.fixture(scope="session")
def server():
    """One for all tests that leave its map as it is, or make maps of their own."""
    running = start(*encoder(), zenoh=True)
    yield running
    running.stop()


@pytest.fixture(scope="session")
def room(server):
    """The map "default" of that server, once the simulated room is in it."""
    with orenx.connect(server.grpc) as client:
        labels = bool(encoder())
        report = client.map("default").stream_frames(
            scene.frames(24, labels=labels), "rover", "front"
        )
        assert report.integrated == 24, report
        yield server


@pytest.fixture(params=["grpc", "zenoh"])
def default(request, room):
    """That map, over either transport."""
    if request.param == "zenoh":
        pytest.importorskip("zenoh", reason="skipped: eclipse-zenoh is not installed")
    with orenx.connect(getattr(room, request.param)) as client:
        yield client.map("default")


@pytest.fixture
def client(server):
    with orenx.connect(server.grpc) as connected:
        yield connected
