"""The client for asyncio: `await orenx.aio.connect(...)`. The same verbs, answers and errors."""

from __future__ import annotations

import asyncio
import pathlib
from collections import deque
from collections.abc import (
    AsyncIterable,
    AsyncIterator,
    Awaitable,
    Iterable,
    Mapping,
)
from typing import Any, Callable, TypeVar

import grpc.aio
from typing_extensions import Concatenate, ParamSpec

from . import aio_files, over_grpc
from .address import Access, Grpc, Pem, read_url
from .aio_stream import FrameStream
from .books import Books, Policy, StreamReport
from .errors import Error, UnavailableError
from .files import Path
from .frames import Ack, Frame
from .over_zenoh import PATIENCE_S, ZenohSession
from .signatures import Method
from .v1 import ingest_pb2
from .verbs import (
    Ask,
    admin,
    edits,
    language,
    maps,
    planner,
    query,
    render,
    snapshots,
    watch,
)

P = ParamSpec("P")
A = TypeVar("A")


def _asks(build: Callable[Concatenate[str, P], Ask[A]]) -> Method[P, Awaitable[A]]:
    """Sends the question; the answer is awaited."""

    async def send(client: Client, make: Callable[[], Ask[A]]) -> A:
        return await client._ask(make())

    return Method(build, send)


def _watches(build: Callable[Concatenate[str, P], Ask[A]]) -> Method[P, AsyncIterator[A]]:
    """Sends the question; the answers come one after another."""

    def send(client: Client, make: Callable[[], Ask[A]]) -> AsyncIterator[A]:
        return client._watch(make())

    return Method(build, send, "AsyncIterator[{}]")


class Map:
    """One map of a server. Making one asks nothing."""

    def __init__(self, client: Client, map_id: str):
        """As Client.map does."""
        self._client = client
        self.map_id = map_id

    def __repr__(self) -> str:
        """Its name and where it is."""
        return f"orenx.aio.Map({self.map_id!r} at {self._client.url})"

    query_points = _asks(query.query_points)
    query_spheres = _asks(planner.query_spheres)
    check_trajectories = _asks(planner.check_trajectories)
    cast_rays = _asks(planner.cast_rays)
    nearest = _asks(planner.nearest)
    grid = _asks(planner.grid)
    slice = _asks(planner.slice)
    render = _asks(render.render)
    ask = _asks(language.ask)
    ask_embedding = _asks(language.ask_embedding)
    classify = _asks(language.classify)
    encoders = _asks(language.encoders)
    info = _asks(maps.info)
    stats = _asks(maps.stats)
    reset = _asks(maps.reset)
    clear = _asks(edits.clear)
    stamp = _asks(edits.stamp)
    list_snapshots = _asks(snapshots.list_snapshots)
    create_snapshot = _asks(snapshots.create_snapshot)
    restore_snapshot = _asks(snapshots.restore_snapshot)
    delete_snapshot = _asks(snapshots.delete_snapshot)
    watch_region = _watches(watch.watch_region)
    watch_trajectory = _watches(watch.watch_trajectory)

    async def download_snapshot(
        self, name: str, path: Path, *, timeout_s: float | None = None
    ) -> pathlib.Path:
        """Fetches a snapshot into a file, which has its name once it is whole.

        A file that is there is replaced. Without timeout_s it takes what time it takes.
        """
        ask = snapshots.download(self.map_id, name, timeout_s=timeout_s)
        return await aio_files.download(self._client._grpc(), self._client._access, ask, path)

    async def upload_snapshot(
        self, name: str, path: Path, *, timeout_s: float | None = None
    ) -> snapshots.Snapshot:
        """Sends a file, to be a snapshot of this name; the server checks every byte of it first.

        Without timeout_s it takes what time it takes.
        """
        ask = snapshots.upload(self.map_id, name, timeout_s=timeout_s)
        return await self._client._upload(ask, path)

    async def open_stream(
        self,
        robot_id: str,
        sensor_id: str = "camera",
        *,
        policy: Policy = "latest",
        buffer: int = 2,
        window: int = 8,
        on_ack: Callable[[Ack], None] | None = None,
    ) -> FrameStream:
        """A stream to send frames into, one after another. `on_ack` is called on the loop."""
        books = Books(self.map_id, robot_id, sensor_id, policy, buffer, window)
        return await self._client._open_stream(books, on_ack)

    async def stream_frames(
        self,
        frames: Iterable[Frame] | AsyncIterable[Frame],
        robot_id: str,
        sensor_id: str = "camera",
        *,
        policy: Policy = "block",
        buffer: int = 2,
        window: int = 8,
        on_ack: Callable[[Ack], None] | None = None,
    ) -> StreamReport:
        """Sends all of them, waits for the last word on each, and says what became of them."""
        stream = await self.open_stream(
            robot_id, sensor_id, policy=policy, buffer=buffer, window=window, on_ack=on_ack
        )
        async with stream:
            async for frame in _each(frames):
                await stream.send(frame)
            return await stream.close()

    async def stream_acks(
        self,
        frames: Iterable[Frame] | AsyncIterable[Frame],
        robot_id: str,
        sensor_id: str = "camera",
        *,
        policy: Policy = "block",
        buffer: int = 2,
        window: int = 8,
    ) -> AsyncIterator[Ack]:
        """The same, as an iterator of acks; frames are taken as the acks are read."""
        heard: deque[Ack] = deque()
        stream = await self.open_stream(
            robot_id, sensor_id, policy=policy, buffer=buffer, window=window, on_ack=heard.append
        )
        async with stream:
            async for frame in _each(frames):
                await stream.send(frame)
                while heard:
                    yield heard.popleft()
            await stream.close()
        while heard:
            yield heard.popleft()


async def _each(frames: Iterable[Frame] | AsyncIterable[Frame]) -> AsyncIterator[Frame]:
    if isinstance(frames, AsyncIterable):
        async for frame in frames:
            yield frame
    else:
        for frame in frames:
            yield frame


class Client:
    """A connection to one server, for one loop."""

    def __init__(self, url: str, access: Access, timeout_s: float):
        """As `connect` does; connects to gRPC with the first call."""
        self.url = url
        self._access = access
        self._timeout_s = timeout_s
        self._address = read_url(url)
        self._channel: grpc.aio.Channel | None = None
        self._session: ZenohSession | None = None
        if isinstance(self._address, Grpc):
            target, options = self._address.target, over_grpc.OPTIONS
            secret = over_grpc.credentials(self._address, access)
            self._channel = (
                grpc.aio.insecure_channel(target, options=options)
                if secret is None
                else grpc.aio.secure_channel(target, secret, options=options)
            )

    async def _join(self, wait_s: float) -> None:
        if self._channel is None:
            address = self._address
            assert not isinstance(address, Grpc)
            self._session = await asyncio.to_thread(ZenohSession, address, self._access)
        elif wait_s > 0:
            try:
                await asyncio.wait_for(self._channel.channel_ready(), wait_s)
            except asyncio.TimeoutError:
                raise UnavailableError(f"no server answers at {self.url}") from None

    def map(self, map_id: str = "default") -> Map:
        """A map of the server; whether there is one is asked with the first question."""
        return Map(self, map_id)

    async def maps(self, *, timeout_s: float | None = None) -> list[maps.MapSummary]:
        """All maps of the server."""
        return await self._ask(maps.list_maps(timeout_s=timeout_s))

    async def create_map(
        self,
        map_id: str,
        settings: Mapping[str, object] | None = None,
        *,
        timeout_s: float | None = None,
    ) -> Map:
        """Makes an empty map. Settings are those of [map] that differ, as in {"r0_m": 0.05}."""
        await self._ask(maps.create_map(map_id, settings, timeout_s=timeout_s))
        return self.map(map_id)

    async def delete_map(self, map_id: str, *, timeout_s: float | None = None) -> None:
        """Deletes a map and all that is stored of it."""
        await self._ask(maps.delete_map(map_id, timeout_s=timeout_s))

    async def settings(self, *, timeout_s: float | None = None) -> str:
        """The settings that the server runs on, TOML, without its keys."""
        return await self._ask(admin.settings(timeout_s=timeout_s))

    async def set_log_level(self, level: str, *, timeout_s: float | None = None) -> str:
        """Changes what the server writes to its log; returns what it was before."""
        return await self._ask(admin.set_log_level(level, timeout_s=timeout_s))

    async def close(self) -> None:
        """Ends the connection."""
        if self._channel is not None:
            await self._channel.close()
        if self._session is not None:
            await asyncio.to_thread(self._session.close)

    async def __aenter__(self) -> Client:
        """Itself."""
        return self

    async def __aexit__(self, *_: Any) -> None:
        """Ends the connection."""
        await self.close()

    async def _ask(self, ask: Ask[A]) -> A:
        timeout_s = self._timeout_s if ask.timeout_s is None else ask.timeout_s
        if self._session is not None:
            # Zenoh's own calls block.
            return ask.read(await asyncio.to_thread(self._session.ask, ask, timeout_s))
        call: Any = self._grpc().unary_unary(over_grpc.path(ask))
        try:
            reply = await call(ask.request, **over_grpc.options_of(self._access, timeout_s))
        except grpc.RpcError as error:
            raise over_grpc.error_of_call(error) from None
        return ask.read(reply)

    def _grpc(self) -> grpc.aio.Channel:
        if self._channel is None:
            raise Error(f"not to be had over {self.url}, but over gRPC", code="UNIMPLEMENTED")
        return self._channel

    async def _watch(self, ask: Ask[A]) -> AsyncIterator[A]:
        if self._session is not None:
            news = await asyncio.to_thread(self._session.watch, ask, self._timeout_s)
            try:
                while (said := await asyncio.to_thread(news.next_or_none)) is not None:
                    yield ask.read(said)
            finally:
                news.close()
            return
        call: Any = self._grpc().unary_stream(over_grpc.path(ask))
        started = call(ask.request, **over_grpc.options_of(self._access, None))
        try:
            async for data in started:
                yield ask.read(data)
        except grpc.RpcError as error:
            raise over_grpc.error_of_call(error) from None
        finally:
            started.cancel()

    async def _upload(self, ask: Ask[A], path: Path) -> A:
        self._grpc()
        assert isinstance(self._address, Grpc)
        channel = over_grpc.open_channel(self._address, self._access)
        return await aio_files.upload(channel, self._access, ask, path)

    async def _open_stream(self, books: Books, on_ack: Callable[[Ack], None] | None) -> FrameStream:
        if self._session is not None:
            stream = FrameStream(books, PATIENCE_S, on_ack)
            await _zenoh_frames(self._session, books, stream)
        else:
            stream = FrameStream(books, None, on_ack)
            _grpc_frames(self._grpc(), self._access, stream)
        return stream


def _grpc_frames(channel: grpc.aio.Channel, access: Access, stream: FrameStream) -> None:
    async def messages() -> AsyncIterator[bytes]:
        # The server answers a stream at once. Nothing is written to one that it refuses: where a write
        # meets the end of its call, grpc.aio says "Internal error from Core", and not why it ended.
        await call.initial_metadata()
        async for _, message in stream.outgoing():
            yield message

    method: Any = channel.stream_stream(over_grpc.STREAM_FRAMES)
    call = method(messages(), **over_grpc.options_of(access, None))

    async def read() -> None:
        try:
            async for data in call:
                stream.hear(ingest_pb2.FrameAck.FromString(data))
            stream.end(None)
        except grpc.RpcError as error:
            stream.end(over_grpc.error_of_call(error))
        except asyncio.CancelledError:
            stream.end(UnavailableError("the stream was cancelled"))

    reading = asyncio.get_running_loop().create_task(read())

    async def stop() -> None:
        call.cancel()
        await reading

    stream._stop = stop


async def _zenoh_frames(session: ZenohSession, books: Books, stream: FrameStream) -> None:
    loop = asyncio.get_running_loop()

    def heard(ack: ingest_pb2.FrameAck) -> None:
        loop.call_soon_threadsafe(stream.hear, ack)

    subscriber = await asyncio.to_thread(session.hear, books.names, heard)

    async def write() -> None:
        try:
            async for _, message in stream.outgoing():
                await asyncio.to_thread(session.put, books.names, message)
        except Error as error:
            stream.end(error)

    writing = loop.create_task(write())

    async def stop() -> None:
        await writing
        await asyncio.to_thread(subscriber.undeclare)

    stream._stop = stop


async def connect(
    url: str = "grpc://127.0.0.1:7610",
    *,
    api_key: str | None = None,
    ca: Pem = None,
    cert: Pem = None,
    key: Pem = None,
    timeout_s: float = 30.0,
    wait_s: float = 5.0,
) -> Client:
    """As `orenx.connect`."""
    client = Client(url, Access(api_key, ca, cert, key), timeout_s)
    try:
        await client._join(wait_s)
    except BaseException:
        await client.close()
        raise
    return client


__all__ = ["Client", "FrameStream", "Map", "connect"]
