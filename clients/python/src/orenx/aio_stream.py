"""Frames to a server, from a loop of asyncio."""

from __future__ import annotations

import asyncio
import inspect
import time
from collections.abc import AsyncIterator
from typing import Any, Callable

from .books import Books, StreamReport
from .errors import DeadlineExceededError, UnavailableError
from .frames import Ack, Frame, read_ack
from .v1 import ingest_pb2

# How often lost frames are looked for, where they may get lost.
_LOOK_S = 0.5


class FrameStream:
    """As `orenx.FrameStream`, for one loop."""

    def __init__(
        self,
        books: Books,
        patience_s: float | None,
        on_ack: Callable[[Ack], None] | None,
    ):
        """Begun by Map.open_stream."""
        self._books = books
        self._changed = asyncio.Event()
        self._patience_s = patience_s
        self._on_ack = on_ack
        self._ended = False
        self._is_stopped = False
        self._error: BaseException | None = None
        self._stop: Callable[[], Any] = lambda: None

    async def send(self, frame: Frame, *, timeout_s: float | None = None) -> None:
        """Takes a frame in, or waits for room; raises if it is no frame, or if the stream ended."""
        message = self._books.encode(frame)
        if self._books.is_closed:
            raise ValueError("the stream is closed")
        if not await self._wait(self._books.has_room, timeout_s):
            raise DeadlineExceededError(f"no room for a frame within {timeout_s} s")
        self._tell(self._books.add(message))
        self._changed.set()
        # So that a sender that never waits leaves the loop to what it sends.
        await asyncio.sleep(0)

    async def close(self, *, timeout_s: float | None = None) -> StreamReport:
        """Sends what waits, waits for the last word on every frame, and says what became of them."""
        self._books.is_closed = True
        self._changed.set()
        if not await self._wait(self._books.is_done, timeout_s):
            raise DeadlineExceededError(f"frames without a verdict after {timeout_s} s")
        await self._stop_once()
        return self.report

    async def cancel(self) -> None:
        """Ends the stream at once, whatever waits."""
        self._books.is_closed = True
        self._books.waiting.clear()
        self._ended = True
        self._changed.set()
        await self._stop_once()

    @property
    def report(self) -> StreamReport:
        """What became of the frames so far."""
        return self._books.report()

    async def __aenter__(self) -> FrameStream:
        """Frames may be sent."""
        return self

    async def __aexit__(self, kind: Any, *_: Any) -> None:
        """Closes, or cancels where something went wrong."""
        if kind is None:
            await self.close()
        else:
            await self.cancel()

    async def _stop_once(self) -> None:
        if self._is_stopped:
            return
        self._is_stopped = True
        stopping = self._stop()
        if inspect.isawaitable(stopping):
            await stopping

    async def _wait(self, until: Callable[[], bool], timeout_s: float | None = None) -> bool:
        """Waits for what is so. False if the time is over."""
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        in_time = True
        while not (self._ended or until()):
            left = None if deadline is None else deadline - time.monotonic()
            if left is not None and left <= 0:
                in_time = False
                break
            if self._patience_s is not None:
                left = _LOOK_S if left is None else min(left, _LOOK_S)
            # Nobody else runs between the look above and this.
            self._changed.clear()
            try:
                await asyncio.wait_for(self._changed.wait(), left)
            except asyncio.TimeoutError:
                if self._patience_s is not None:
                    self._tell(self._books.overdue(self._patience_s))
        if self._error is not None:
            raise self._error
        if self._ended and not until():
            raise UnavailableError("the stream ended before its frames had a last word")
        return in_time

    # --- for the transport

    async def outgoing(self) -> AsyncIterator[tuple[int, bytes]]:
        """Frames as they may be sent, until the stream is closed."""
        while True:
            while not (self._ended or self._books.is_sent() or self._books.may_send()):
                self._changed.clear()
                await self._changed.wait()
            if self._ended or self._books.is_sent():
                return
            taken = self._books.take()
            self._changed.set()
            yield taken

    def hear(self, message: ingest_pb2.FrameAck) -> None:
        """Takes an ack down."""
        ack = read_ack(message)
        if not self._books.settle(ack):
            return
        said = [ack]
        if self._patience_s is not None and ack.status == "integrated":
            # Frames of a sensor are integrated in their order: the words on those before are lost.
            said += self._books.lost(ack.seq)
        self._changed.set()
        self._tell(said)

    def end(self, error: BaseException | None) -> None:
        """The transport has nothing more to say."""
        self._ended = True
        if not self._is_stopped:
            self._error = self._error or error
        self._changed.set()

    def _tell(self, acks: list[Ack]) -> None:
        if self._on_ack is None:
            return
        for ack in acks:
            try:
                self._on_ack(ack)
            except Exception as error:  # belongs to the sender
                self.end(error)
                return
