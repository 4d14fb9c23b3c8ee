"""What can be asked, one file a proto file: how a question becomes bytes, and bytes an answer.

Nothing here knows a transport or whether somebody waits: `Map` and `aio.Map` send the same `Ask`s.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Callable, Generic, Literal, TypeVar

import numpy as np
from typing_extensions import TypedDict

from ..errors import InvalidArgumentError
from ..v1 import query_pb2

A = TypeVar("A")
N = TypeVar("N", bound=np.generic)

Unknown = Literal["report", "free", "occupied"]


@dataclass(frozen=True)
class Ask(Generic[A]):
    """A question, encoded, and how its answer is read."""

    # In orenx.v1, as in "Query/QueryPoints".
    method: str
    # The last chunk of the key over Zenoh; None where Zenoh has no such question.
    verb: str | None
    map_id: str
    # The name of the message that is sent.
    message: str
    request: bytes
    read: Callable[[bytes], A]
    timeout_s: float | None = None


@dataclass(frozen=True, eq=False)
class Answer:
    """What every answer says: the map's version, the capture time of its newest frame, the time spent."""

    epoch: int
    newest_stamp_ns: int
    server_us: int


class Fresh(TypedDict, total=False):
    """How new the map must be, and how long to wait for the answer.

    min_epoch: fail with FailedPreconditionError if the map is older; an ack says which epoch holds a frame.
    max_age_ms: fail likewise if the newest frame came to the server longer ago.
    timeout_s: how long an answer may take.
    """

    min_epoch: int
    max_age_ms: int
    timeout_s: float | None


class Seen(Fresh, total=False):
    """Freshness, and how what nobody has seen counts: "report", "free" or "occupied"."""

    unknown: Unknown


class Terms(Seen, total=False):
    """All that, and the distance of unknown points under "free" and "occupied", m.

    Under "report", the default, the numbers of unknown points are NaN.
    """

    unknown_distance_m: float | None


def terms_to_wire(terms: Mapping[str, Any], kind: type = Terms) -> dict[str, Any]:
    """The fields of a request that many questions share."""
    known = kind.__annotations__.keys()
    for name in terms:
        if name not in known:
            raise TypeError(f"unexpected argument '{name}' (there are {', '.join(known)})")
    fields: dict[str, Any] = {}
    for name in ("min_epoch", "max_age_ms"):
        if terms.get(name):
            fields[name] = int(terms[name])
    if "unknown" in terms:
        fields["unknown_policy"] = enum(
            query_pb2.UnknownPolicy, "UNKNOWN_POLICY_", "unknown", terms["unknown"]
        )
    if terms.get("unknown_distance_m") is not None:
        fields["unknown_distance_m"] = float(terms["unknown_distance_m"])
    return fields


def enum(kind: Any, prefix: str, field: str, name: str) -> Any:
    """The number of a name such as "free"."""
    try:
        return kind.Value(prefix + name.upper())
    except (ValueError, AttributeError):
        names = [n[len(prefix) :].lower() for n in list(kind.keys())]
        known = ", ".join(n for n in names if n != "unspecified")
        problem = f"{field}: '{name}' is not one of {known}"
        raise InvalidArgumentError(problem, field=field) from None


def enum_name(kind: Any, prefix: str, number: int) -> str:
    """The name of a number; one that is newer than this client stays a number."""
    name = {value: key for key, value in kind.items()}.get(number)
    return str(number) if name is None else str(name)[len(prefix) :].lower()


def head(reply: Any) -> dict[str, int]:
    """What every answer says."""
    return {
        "epoch": reply.epoch,
        "newest_stamp_ns": reply.newest_stamp_ns,
        "server_us": reply.server_us,
    }
