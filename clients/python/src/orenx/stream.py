"""Frames to a server, from threads."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from typing import Any, Callable

from .books import Books, StreamReport
from .errors import DeadlineExceededError, Error, UnavailableError
from .frames import Ack, Frame, read_ack
from .v1 import ingest_pb2

# How often lost frames are looked for, where they may get lost.
_LOOK_S = 0.5

Outgoing = Iterator[tuple[int, bytes]]


class FrameStream:
    """A stream of one sensor, to be used in a `with` block; `Map.open_stream` makes one.

    At most `buffer` frames wait here, and at most `window` are under way without a last word. `send` waits
    under "block"; under "latest" the oldest waiting frame gives way.
    """

    def __init__(
        self,
        books: Books,
        start: Callable[[FrameStream], Callable[[], None]],
        patience_s: float | None,
        on_ack: Callable[[Ack], None] | None,
    ):
        """Begins: `start` moves `outgoing` to the server until it gets called back to stop."""
        self._books = books
        # Reentrant: what a callback is told of may make it ask for the report.
        self._changed = threading.Condition(threading.RLock())
        self._patience_s = patience_s
        self._on_ack = on_ack
        self._ended = False
        self._is_stopped = False
        self._error: BaseException | None = None
        self._stop = start(self)

    # --- for the sender

    def send(self, frame: Frame, *, timeout_s: float | None = None) -> None:
        """Takes a frame in, or waits for room; raises if it is no frame, or if the stream ended."""
        message = self._books.encode(frame)
        with self._changed:
            if self._books.is_closed:
                raise ValueError("the stream is closed")
            if not self._wait(self._books.has_room, timeout_s):
                raise DeadlineExceededError(f"no room for a frame within {timeout_s} s")
            gone = self._books.add(message)
            self._changed.notify_all()
        self._tell(gone)

    def close(self, *, timeout_s: float | None = None) -> StreamReport:
        """Sends what waits, waits for the last word on every frame, and says what became of them."""
        with self._changed:
            self._books.is_closed = True
            self._changed.notify_all()
            if not self._wait(self._books.is_done, timeout_s):
                raise DeadlineExceededError(f"frames without a verdict after {timeout_s} s")
        self._stop_once()
        return self.report

    def cancel(self) -> None:
        """Ends the stream at once, whatever waits."""
        with self._changed:
            self._books.is_closed = True
            self._books.waiting.clear()
            self._ended = True
            self._changed.notify_all()
        self._stop_once()

    @property
    def report(self) -> StreamReport:
        """What became of the frames so far."""
        with self._changed:
            return self._books.report()

    def __enter__(self) -> FrameStream:
        """Frames may be sent."""
        return self

    def __exit__(self, kind: Any, *_: Any) -> None:
        """Closes, or cancels where something went wrong."""
        if kind is None:
            self.close()
        else:
            self.cancel()

    def _stop_once(self) -> None:
        with self._changed:
            was_stopped, self._is_stopped = self._is_stopped, True
        if not was_stopped:
            self._stop()

    def _wait(self, until: Callable[[], bool], timeout_s: float | None) -> bool:
        """Waits with the lock held. False if the time is over."""

        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        in_time = True
        while not (self._ended or until()):
            left = None if deadline is None else deadline - time.monotonic()
            if left is not None and left <= 0:
                in_time = False
                break
            if self._patience_s is not None:
                left = _LOOK_S if left is None else min(left, _LOOK_S)
            self._changed.wait(left)
            self._tell_overdue()
        if self._error is not None:
            raise self._error
        if self._ended and not until():
            raise UnavailableError("the stream ended before its frames had a last word")
        return in_time

    # --- for the transport

    def outgoing(self) -> Outgoing:
        """Frames as they may be sent, until the stream is closed."""
        while True:
            with self._changed:
                self._changed.wait_for(
                    lambda: self._ended or self._books.is_sent() or self._books.may_send()
                )
                if self._ended or self._books.is_sent():
                    return
                seq, message = self._books.take()
                self._changed.notify_all()
            yield seq, message

    def hear(self, message: ingest_pb2.FrameAck) -> None:
        """Takes an ack down."""
        ack = read_ack(message)
        with self._changed:
            if not self._books.settle(ack):
                return
            said = [ack]
            if self._patience_s is not None and ack.status == "integrated":
                # Frames of a sensor are integrated in their order: the words on those before are lost.
                said += self._books.lost(ack.seq)
            self._changed.notify_all()
        self._tell(said)

    def end(self, error: Error | None) -> None:
        """The transport has nothing more to say."""
        with self._changed:
            self._ended = True
            if not self._is_stopped:
                self._error = self._error or error
            self._changed.notify_all()

    def _tell_overdue(self) -> None:
        if self._patience_s is not None:
            self._tell(self._books.overdue(self._patience_s))

    def _tell(self, acks: list[Ack]) -> None:
        if self._on_ack is None:
            return
        for ack in acks:
            try:
                self._on_ack(ack)
            except BaseException as error:  # belongs to the sender, not to the network's thread
                with self._changed:
                    self._error = self._error or error
                    self._ended = True
                    self._changed.notify_all()
                return
