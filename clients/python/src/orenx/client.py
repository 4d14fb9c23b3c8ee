"""The client for threads: `orenx.connect`."""

from __future__ import annotations

import pathlib
import threading
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Callable, Generic, TypeVar

import grpc
from typing_extensions import Concatenate, ParamSpec

from . import files, over_grpc
from .address import Access, Grpc, Pem, read_url
from .books import Books, Policy, StreamReport
from .errors import Error, UnavailableError
from .files import Path
from .frames import Ack, Frame
from .over_zenoh import PATIENCE_S, ZenohSession
from .signatures import Method
from .stream import FrameStream
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


def _asks(build: Callable[Concatenate[str, P], Ask[A]]) -> Method[P, A]:
    """Sends the question and waits for the answer."""

    def send(client: Client, make: Callable[[], Ask[A]]) -> A:
        return client._ask(make())

    return Method(build, send)


def _watches(build: Callable[Concatenate[str, P], Ask[A]]) -> Method[P, Watch[A]]:
    """Sends the question; the answers come one after another."""

    def send(client: Client, make: Callable[[], Ask[A]]) -> Watch[A]:
        return client._watch(make())

    return Method(build, send, "Watch[{}]")


class Map:
    """One map of a server. Making one asks nothing."""

    def __init__(self, client: Client, map_id: str):
        """As Client.map does."""
        self._client = client
        self.map_id = map_id

    def __repr__(self) -> str:
        """Its name and where it is."""
        return f"orenx.Map({self.map_id!r} at {self._client.url})"

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

    def download_snapshot(
        self, name: str, path: Path, *, timeout_s: float | None = None
    ) -> pathlib.Path:
        """Fetches a snapshot into a file, which has its name once it is whole.

        A file that is there is replaced. Without timeout_s it takes what time it takes.
        """
        ask = snapshots.download(self.map_id, name, timeout_s=timeout_s)
        return files.download(self._client._grpc(), self._client._access, ask, path)

    def upload_snapshot(
        self, name: str, path: Path, *, timeout_s: float | None = None
    ) -> snapshots.Snapshot:
        """Sends a file, to be a snapshot of this name; the server checks every byte of it first.

        Without timeout_s it takes what time it takes.
        """
        ask = snapshots.upload(self.map_id, name, timeout_s=timeout_s)
        return files.upload(self._client._grpc(), self._client._access, ask, path)

    def open_stream(
        self,
        robot_id: str,
        sensor_id: str = "camera",
        *,
        policy: Policy = "latest",
        buffer: int = 2,
        window: int = 8,
        on_ack: Callable[[Ack], None] | None = None,
    ) -> FrameStream:
        """A stream to send frames into, one after another. `on_ack` is called on the network's thread."""
        books = Books(self.map_id, robot_id, sensor_id, policy, buffer, window)
        return self._client._open_stream(books, on_ack)

    def stream_frames(
        self,
        frames: Iterable[Frame],
        robot_id: str,
        sensor_id: str = "camera",
        *,
        policy: Policy = "block",
        buffer: int = 2,
        window: int = 8,
        on_ack: Callable[[Ack], None] | None = None,
    ) -> StreamReport:
        """Sends all of them, waits for the last word on each, and says what became of them."""
        stream = self.open_stream(
            robot_id, sensor_id, policy=policy, buffer=buffer, window=window, on_ack=on_ack
        )
        with stream:
            for frame in frames:
                stream.send(frame)
            return stream.close()

    def stream_acks(
        self,
        frames: Iterable[Frame],
        robot_id: str,
        sensor_id: str = "camera",
        *,
        policy: Policy = "block",
        buffer: int = 2,
        window: int = 8,
    ) -> Iterator[Ack]:
        """The same, as an iterator of acks; frames are taken as the acks are read."""
        heard: deque[Ack] = deque()
        stream = self.open_stream(
            robot_id, sensor_id, policy=policy, buffer=buffer, window=window, on_ack=heard.append
        )
        with stream:
            for frame in frames:
                stream.send(frame)
                while heard:
                    yield heard.popleft()
            stream.close()
        yield from heard


class Watch(Generic[A]):
    """Answers as they come: an iterator, and a context that ends the watch."""

    def __init__(
        self, news: Iterator[bytes], cancel: Callable[[], Any], read: Callable[[bytes], A]
    ):
        """Of a watch under way."""
        self._news = news
        self._cancel = cancel
        self._read = read
        self._is_closed = False

    def __iter__(self) -> Iterator[A]:
        """Itself."""
        return self

    def __next__(self) -> A:
        """Waits for the next one; ends once the watch is closed."""
        try:
            return self._read(next(self._news))
        except grpc.RpcError as error:
            if self._is_closed:
                raise StopIteration from None
            raise over_grpc.error_of_call(error) from None

    def close(self) -> None:
        """Ends the watch; whoever waits for its next answer gets none."""
        self._is_closed = True
        self._cancel()

    def __enter__(self) -> Watch[A]:
        """Itself."""
        return self

    def __exit__(self, *_: Any) -> None:
        """Ends the watch."""
        self.close()


class Client:
    """A connection to one server. Threads may share it."""

    def __init__(self, url: str, access: Access, timeout_s: float):
        """As `connect` does."""
        self.url = url
        self._access = access
        self._timeout_s = timeout_s
        address = read_url(url)
        self._channel: grpc.Channel | None = None
        self._session: ZenohSession | None = None
        if isinstance(address, Grpc):
            self._channel = over_grpc.open_channel(address, access)
        else:
            self._session = ZenohSession(address, access)

    def map(self, map_id: str = "default") -> Map:
        """A map of the server; whether there is one is asked with the first question."""
        return Map(self, map_id)

    def maps(self, *, timeout_s: float | None = None) -> list[maps.MapSummary]:
        """All maps of the server."""
        return self._ask(maps.list_maps(timeout_s=timeout_s))

    def create_map(
        self,
        map_id: str,
        settings: Mapping[str, object] | None = None,
        *,
        timeout_s: float | None = None,
    ) -> Map:
        """Makes an empty map. Settings are those of [map] that differ, as in {"r0_m": 0.05}."""
        self._ask(maps.create_map(map_id, settings, timeout_s=timeout_s))
        return self.map(map_id)

    def delete_map(self, map_id: str, *, timeout_s: float | None = None) -> None:
        """Deletes a map and all that is stored of it."""
        self._ask(maps.delete_map(map_id, timeout_s=timeout_s))

    def settings(self, *, timeout_s: float | None = None) -> str:
        """The settings that the server runs on, TOML, without its keys."""
        return self._ask(admin.settings(timeout_s=timeout_s))

    def set_log_level(self, level: str, *, timeout_s: float | None = None) -> str:
        """Changes what the server writes to its log; returns what it was before."""
        return self._ask(admin.set_log_level(level, timeout_s=timeout_s))

    def close(self) -> None:
        """Ends the connection."""
        if self._channel is not None:
            self._channel.close()
        if self._session is not None:
            self._session.close()

    def __enter__(self) -> Client:
        """Itself."""
        return self

    def __exit__(self, *_: Any) -> None:
        """Ends the connection."""
        self.close()

    def wait_ready(self, timeout_s: float) -> None:
        """Waits until the server takes connections; raises UnavailableError if it does not."""
        if self._channel is None:
            return
        try:
            grpc.channel_ready_future(self._channel).result(timeout=timeout_s)
        except grpc.FutureTimeoutError:
            raise UnavailableError(f"no server answers at {self.url}") from None

    def _ask(self, ask: Ask[A]) -> A:
        timeout_s = self._timeout_s if ask.timeout_s is None else ask.timeout_s
        if self._session is not None:
            return ask.read(self._session.ask(ask, timeout_s))
        call: Any = self._grpc().unary_unary(over_grpc.path(ask))
        try:
            reply = call(ask.request, **over_grpc.options_of(self._access, timeout_s))
        except grpc.RpcError as error:
            raise over_grpc.error_of_call(error) from None
        return ask.read(reply)

    def _grpc(self) -> grpc.Channel:
        if self._channel is None:
            raise Error(f"not to be had over {self.url}, but over gRPC", code="UNIMPLEMENTED")
        return self._channel

    def _watch(self, ask: Ask[A]) -> Watch[A]:
        if self._session is not None:
            news = self._session.watch(ask, self._timeout_s)
            return Watch(iter(news), news.close, ask.read)
        call: Any = self._grpc().unary_stream(over_grpc.path(ask))
        started = call(ask.request, **over_grpc.options_of(self._access, None))
        return Watch(started, started.cancel, ask.read)

    def _open_stream(self, books: Books, on_ack: Callable[[Ack], None] | None) -> FrameStream:
        if self._session is not None:
            start = _zenoh_frames(self._session, books)
            return FrameStream(books, start, PATIENCE_S, on_ack)
        return FrameStream(books, _grpc_frames(self._grpc(), self._access), None, on_ack)


Start = Callable[[FrameStream], Callable[[], None]]


def _grpc_frames(channel: grpc.Channel, access: Access) -> Start:
    def start(stream: FrameStream) -> Callable[[], None]:
        outgoing = (message for _, message in stream.outgoing())
        method: Any = channel.stream_stream(over_grpc.STREAM_FRAMES)
        call = method(outgoing, **over_grpc.options_of(access, None))

        def read() -> None:
            try:
                for data in call:
                    stream.hear(ingest_pb2.FrameAck.FromString(data))
                stream.end(None)
            except grpc.RpcError as error:
                stream.end(over_grpc.error_of_call(error))

        threading.Thread(target=read, name="orenx-acks", daemon=True).start()

        def stop() -> None:
            call.cancel()

        return stop

    return start


def _zenoh_frames(session: ZenohSession, books: Books) -> Start:
    def start(stream: FrameStream) -> Callable[[], None]:
        subscriber = session.hear(books.names, stream.hear)

        def write() -> None:
            try:
                for _, message in stream.outgoing():
                    session.put(books.names, message)
            except Error as error:
                stream.end(error)

        threading.Thread(target=write, name="orenx-frames", daemon=True).start()

        def stop() -> None:
            subscriber.undeclare()

        return stop

    return start


def connect(
    url: str = "grpc://127.0.0.1:7610",
    *,
    api_key: str | None = None,
    ca: Pem = None,
    cert: Pem = None,
    key: Pem = None,
    timeout_s: float = 30.0,
    wait_s: float = 5.0,
) -> Client:
    """Connects to a server: grpc://host:port, grpcs:// with TLS, or zenoh+tcp://host:port.

    api_key: sent with every call. ca, cert, key: PEM, as bytes or as paths, for grpcs.
    timeout_s: how long an answer may take if the question does not say.
    wait_s: how long to wait for the server to be there; 0 does not look.
    """
    client = Client(url, Access(api_key, ca, cert, key), timeout_s)
    if wait_s > 0:
        try:
            client.wait_ready(wait_s)
        except BaseException:
            client.close()
            raise
    return client


__all__ = ["Client", "Map", "Watch", "connect"]
