"""One session with a Zenoh network: questions and frames by key, as deploy/zenoh/README.md has them.

Needs the extra `orenx[zenoh]`.
"""

from __future__ import annotations

import contextlib
import json
import queue
from collections.abc import Iterator
from typing import Any, Callable

from .address import ENVELOPE_BYTES, MAX_MESSAGE_BYTES, Access, Zenoh
from .errors import (
    DeadlineExceededError,
    Error,
    InvalidArgumentError,
    UnavailableError,
    error_of_number,
)
from .v1 import ingest_pb2, planner_pb2, query_pb2
from .verbs import Ask

# How long a frame may be without a last word before it is taken for lost.
PATIENCE_S = 10.0
# News of a watch that may wait to be read.
_NEWS = 64


def _import() -> Any:
    try:
        import zenoh
    except ImportError as error:
        raise ImportError("Zenoh needs its package: pip install 'orenx[zenoh]'") from error
    return zenoh


def _config(zenoh: Any, address: Zenoh) -> Any:
    if address.config is not None:
        return zenoh.Config.from_file(address.config)
    config = zenoh.Config()
    for key, value in (
        ("mode", "client"),
        ("connect/endpoints", [address.endpoint]),
        ("connect/timeout_ms", 4000),
        ("scouting/multicast/enabled", False),
        ("transport/link/rx/max_message_size", MAX_MESSAGE_BYTES + ENVELOPE_BYTES),
    ):
        config.insert_json5(key, json.dumps(value))
    return config


class News:
    """What is said on the key of a watch: an iterator of messages, until closed or ended."""

    def __init__(self, zenoh: Any, refusal: Callable[[Any], Error]):
        """Of a key that nobody hears yet."""
        self.subscriber: Any = None
        self._zenoh = zenoh
        self._refusal = refusal
        # A reader that is slow holds the line back, as one of gRPC does: nothing may get lost.
        self._waiting: queue.Queue[bytes | Error | None] = queue.Queue(_NEWS)
        self._is_closed = False

    def take(self, sample: Any) -> None:
        """One message, on a thread of the network."""
        if sample.kind == self._zenoh.SampleKind.DELETE:
            self._put(None)
        elif "QueryError" in str(sample.encoding):
            self._put(self._refusal(sample))
        else:
            self._put(bytes(sample.payload.to_bytes()))

    def _put(self, item: bytes | Error | None) -> None:
        while not self._is_closed:
            try:
                return self._waiting.put(item, timeout=0.1)
            except queue.Full:
                continue
        return None

    def next_or_none(self) -> bytes | None:
        """Waits for the next message; None at the end."""
        if self._is_closed:
            return None
        item = self._waiting.get()
        if isinstance(item, Error):
            raise item
        return item

    def __iter__(self) -> Iterator[bytes]:
        """Its messages."""
        while (item := self.next_or_none()) is not None:
            yield item

    def close(self) -> None:
        """Hears nothing more; whoever waits gets the end."""
        self._is_closed = True
        with contextlib.suppress(queue.Full):
            self._waiting.put_nowait(None)
        if self.subscriber is not None:
            self.subscriber.undeclare()


class ZenohSession:
    """A session. Its methods block; threads may share it."""

    def __init__(self, address: Zenoh, access: Access):
        """Connects to the router or peer."""
        if access.api_key or access.has_tls():
            problem = "url: keys and certificates of Zenoh are in its own file (zenoh+file:PATH)"
            raise InvalidArgumentError(problem, field="url")
        self._zenoh = _import()
        self._prefix = address.prefix
        try:
            self._session = self._zenoh.open(_config(self._zenoh, address))
        except self._zenoh.ZError as error:
            where = address.endpoint or address.config
            raise UnavailableError(f"no server answers at {where}: {error}") from None
        # Tells the server one run of this sender from another.
        self._run = str(self._session.zid()).encode()

    def close(self) -> None:
        """Ends the session."""
        self._session.close()

    def _encoding(self, message: str) -> Any:
        return self._zenoh.Encoding.APPLICATION_PROTOBUF.with_schema(f"orenx.v1.{message}")

    def ask(self, ask: Ask[Any], timeout_s: float) -> bytes:
        """The answer, encoded."""
        if ask.verb is None:
            message = f"{ask.method} is not to be had over Zenoh, but over gRPC"
            raise Error(message, code="UNIMPLEMENTED")
        zenoh = self._zenoh
        key = f"{self._prefix}/{ask.map_id}/q/{ask.verb}"
        replies = self._call(
            self._session.get,
            f"{key}?timeout_ms={max(1, int(timeout_s * 1000))}",
            payload=ask.request,
            encoding=self._encoding(ask.message),
            target=zenoh.QueryTarget.BEST_MATCHING,
            priority=zenoh.Priority.INTERACTIVE_HIGH,
            express=True,
            timeout=timeout_s,
        )
        for reply in replies:
            if reply.ok is not None:
                return bytes(reply.ok.payload.to_bytes())
            raise self._refusal(reply.err)
        raise UnavailableError(f"no server answers at {key}")

    def _refusal(self, refused: Any) -> Error:
        if refused.encoding == self._encoding("QueryError"):
            error = query_pb2.QueryError.FromString(refused.payload.to_bytes())
            return error_of_number(error.code, error.message, error.field)
        said = bytes(refused.payload.to_bytes()).decode("utf-8", "replace")
        return DeadlineExceededError(f"no answer over Zenoh: {said}")

    def _call(self, function: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
        try:
            return function(*args, **kwargs)
        except self._zenoh.ZError as error:
            raise UnavailableError(f"Zenoh: {error}") from None

    def hear(
        self, names: tuple[str, str, str], heard: Callable[[ingest_pb2.FrameAck], None]
    ) -> Any:
        """Hears the acks of a sensor, on a thread of the network, until undeclared."""
        map_id, robot_id, sensor_id = names

        def on_sample(sample: Any) -> None:
            heard(ingest_pb2.FrameAck.FromString(sample.payload.to_bytes()))

        key = f"{self._prefix}/{map_id}/out/ack/{robot_id}/{sensor_id}"
        return self._call(self._session.declare_subscriber, key, on_sample)

    def watch(self, ask: Ask[Any], timeout_s: float) -> News:
        """Begins a watch, and hears what is new."""
        begun = planner_pb2.WatchReply.FromString(self.ask(ask, timeout_s))
        news = News(self._zenoh, self._refusal)
        news.subscriber = self._call(self._session.declare_subscriber, begun.key, news.take)
        return news

    def put(self, names: tuple[str, str, str], message: bytes) -> None:
        """Puts a frame; waits where the line is full."""
        map_id, robot_id, sensor_id = names
        self._call(
            self._session.put,
            f"{self._prefix}/{map_id}/in/{robot_id}/{sensor_id}/frame",
            message,
            encoding=self._encoding("Frame"),
            attachment=self._run,
            congestion_control=self._zenoh.CongestionControl.BLOCK,
        )
