"""The books of a stream of frames: what waits, what is under way, what became of each.

No thread, no loop, no transport: `stream` and `aio` hold a lock around it and wait for it.
"""

from __future__ import annotations

import time
from collections import Counter, deque
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from .errors import InvalidArgumentError
from .frames import Ack, Frame, read_ack
from .v1 import ingest_pb2 as wire

Policy = Literal["latest", "block"]

_POLICIES = {"latest": wire.QUEUE_POLICY_LATEST, "block": wire.QUEUE_POLICY_BLOCK}

# How many problems a report tells in full.
_PROBLEMS = 8


@dataclass
class StreamReport:
    """What became of a stream."""

    frames: int = 0
    integrated: int = 0
    # Frames that a crash of the server does not lose; 0 where it keeps no journal.
    durable: int = 0
    # By reason; "replaced_here" gave way before it was sent.
    dropped: dict[str, int] = field(default_factory=dict)
    rejected: dict[str, int] = field(default_factory=dict)
    # Frames of which nothing was heard, over Zenoh.
    lost: int = 0
    # The newest epoch that holds one of them.
    epoch: int = 0
    seconds: float = 0.0
    # Median and 95th percentile of the time from sending a frame to the ack that it is in the map, ms.
    visible_after_ms: tuple[float, float] = (float("nan"), float("nan"))
    # Why frames were rejected, or are in the map and not durable; in words, each once; at most eight.
    problems: list[str] = field(default_factory=list)

    @property
    def frames_per_second(self) -> float:
        """Integrated frames a second, from the first frame to the last ack."""
        return self.integrated / self.seconds if self.seconds > 0 else 0.0


class Books:
    """One stream of one sensor."""

    def __init__(
        self, map_id: str, robot_id: str, sensor_id: str, policy: Policy, buffer: int, window: int
    ):
        """Buffer bounds frames that wait here, window those that were sent and have no last word."""
        if policy not in _POLICIES:
            problem = f"policy: '{policy}' is neither latest nor block"
            raise InvalidArgumentError(problem, field="policy")
        if buffer < 1 or window < 1:
            raise InvalidArgumentError("buffer, window: at least 1", field="buffer")
        self.names = (map_id, robot_id, sensor_id)
        self.policy: Policy = policy
        self.buffer = buffer
        self.window = window
        self.waiting: deque[tuple[int, bytes]] = deque()
        # By number, when it was sent.
        self.under_way: dict[int, float] = {}
        self.is_closed = False
        self._next = 0
        self._capacity: int | None = None
        self._counts: Counter[str] = Counter()
        self._dropped: Counter[str] = Counter()
        self._rejected: Counter[str] = Counter()
        self._problems: dict[str, None] = {}
        self._epoch = 0
        # Times to the map; of a long stream the newest.
        self._visible: deque[float] = deque(maxlen=100_000)
        self._began: float | None = None
        self._ended = 0.0

    def encode(self, frame: Frame) -> bytes:
        """The next frame as a message. Raises if it is none, which leaves the stream as it was."""
        map_id, robot_id, sensor_id = self.names
        policy = _POLICIES[self.policy]
        message = frame.to_wire(map_id, robot_id, sensor_id, policy)
        return message.SerializeToString()

    def has_room(self) -> bool:
        """Whether a frame may be added; under `latest` always."""
        return self.policy == "latest" or len(self.waiting) < self.buffer

    def add(self, message: bytes) -> list[Ack]:
        """Takes a frame in; tells which gave way."""
        now = time.monotonic()
        self._began = now if self._began is None else self._began
        seq = self._next
        self._next += 1
        # A message and another one behind it are one message: the number is written last.
        numbered = message + wire.Frame(seq=seq).SerializeToString()
        self.waiting.append((seq, numbered))
        gone: list[Ack] = []
        while len(self.waiting) > self.buffer:
            old, _ = self.waiting.popleft()
            _, robot_id, sensor_id = self.names
            ack = wire.FrameAck(robot_id=robot_id, sensor_id=sensor_id, seq=old)
            ack.status = wire.FRAME_STATUS_DROPPED
            said = read_ack(ack)
            said = Ack(**{**said.__dict__, "reason": "replaced_here"})
            self._count(said)
            gone.append(said)
        return gone

    def may_send(self) -> bool:
        """Whether a frame waits and the window has room for it.

        A live sensor sends no more than the server may hold: what waits here is newer than what would
        give way there.
        """
        window = self.window
        if self.policy == "latest" and self._capacity is not None:
            window = min(window, self._capacity + 1)
        return bool(self.waiting) and len(self.under_way) < window

    def take(self) -> tuple[int, bytes]:
        """The next frame to send."""
        seq, message = self.waiting.popleft()
        self.under_way[seq] = time.monotonic()
        return seq, message

    def is_sent(self) -> bool:
        """Nothing will be sent any more."""
        return self.is_closed and not self.waiting

    def is_done(self) -> bool:
        """Every frame had its last word."""
        return self.is_sent() and not self.under_way

    def settle(self, ack: Ack) -> bool:
        """Takes an ack down; false if it is about no frame that is under way."""
        self._capacity = ack.queue_capacity or self._capacity
        if ack.seq not in self.under_way:
            return False
        if ack.status == "durable":
            self._counts["durable"] += 1
        if ack.is_final:
            sent = self.under_way.pop(ack.seq)
            self._ended = time.monotonic()
            if ack.status == "integrated":
                self._visible.append((self._ended - sent) * 1e3)
            self._count(ack)
        return True

    def lost(self, before: int) -> list[Ack]:
        """Frames under way with smaller numbers, of which nothing will be heard."""
        return [self._lose(seq) for seq in sorted(self.under_way) if seq < before]

    def overdue(self, patience_s: float) -> list[Ack]:
        """Frames that were sent too long ago, of which nothing was heard."""
        limit = time.monotonic() - patience_s
        return [self._lose(seq) for seq, sent in sorted(self.under_way.items()) if sent < limit]

    def _lose(self, seq: int) -> Ack:
        _, robot_id, sensor_id = self.names
        self.under_way.pop(seq)
        ack = read_ack(wire.FrameAck(robot_id=robot_id, sensor_id=sensor_id, seq=seq))
        self._count(ack)
        return ack

    def _count(self, ack: Ack) -> None:
        self._counts[ack.status] += 1
        if ack.status == "integrated":
            self._epoch = max(self._epoch, ack.epoch)
            self._note(ack.message)
        elif ack.status == "dropped":
            self._dropped[ack.reason] += 1
        elif ack.status == "rejected":
            self._rejected[ack.reason] += 1
            self._note(ack.message)

    def _note(self, problem: str) -> None:
        if problem and len(self._problems) < _PROBLEMS:
            self._problems[problem] = None

    def report(self) -> StreamReport:
        """What became of the frames so far."""
        visible = (float("nan"), float("nan"))
        if self._visible:
            median, high = np.percentile(np.array(self._visible), [50, 95])
            visible = (float(median), float(high))
        began = self._ended if self._began is None else self._began
        return StreamReport(
            frames=self._next,
            integrated=self._counts["integrated"],
            durable=self._counts["durable"],
            dropped=dict(self._dropped),
            rejected=dict(self._rejected),
            lost=self._counts["lost"],
            epoch=self._epoch,
            seconds=max(0.0, self._ended - began),
            visible_after_ms=visible,
            problems=list(self._problems),
        )
