"""Questions about points (query.proto)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from typing_extensions import Unpack

from .. import packed
from ..geometry import rows
from ..types import F32, U8, Bool
from ..v1 import language_pb2, query_pb2
from . import Answer, Ask, Terms, enum, head, terms_to_wire

Field = Literal["distance", "gradient", "occupancy", "state", "color", "text_score"]

UNKNOWN, FREE, OCCUPIED = 0, 1, 2


@dataclass(frozen=True, eq=False)
class Text:
    """What a place is compared with, in words, or in the numbers of the map's encoder.

    With negatives (the default: "object", "things", "stuff", "texture") a score is a relevancy within 0..1,
    and 0.5 is neither; with `negatives=()` it is a cosine. Of several prompts the best counts.
    """

    prompts: str | Sequence[str] = ()
    negatives: Sequence[str] | None = None
    encoder_id: str = ""
    prompt_embeddings: ArrayLike | None = None
    negative_embeddings: ArrayLike | None = None

    def to_wire(self) -> language_pb2.Text:
        """As a message."""
        return language_pb2.Text(
            encoder_id=self.encoder_id,
            prompt_embeddings=embeddings("prompt_embeddings", self.prompt_embeddings),
            negative_embeddings=embeddings("negative_embeddings", self.negative_embeddings),
            **words(self.prompts, self.negatives),
        )


def words(prompts: str | Sequence[str], negatives: Sequence[str] | None) -> dict[str, Any]:
    """The fields of prompts and negatives."""
    return {
        "prompts": [prompts] if isinstance(prompts, str) else list(prompts),
        "negatives": list(negatives or ()),
        "no_negatives": negatives is not None and len(negatives) == 0,
    }


def embeddings(field: str, values: ArrayLike | None) -> list[language_pb2.Embedding]:
    """(K, D) numbers, or one row of them."""
    if values is None:
        return []
    array = np.asarray(values, np.float32)
    array = array[None] if array.ndim == 1 else array
    return [
        language_pb2.Embedding(values=row.tolist()) for row in rows(field, array, array.shape[-1])
    ]


@dataclass(frozen=True, eq=False)
class Columns(Answer):
    """Numbers in the order of what was asked. A column that was not asked for is None.

    `state` is 0 unknown, 1 free, 2 occupied. Where it is unknown the numbers are NaN, unless `unknown`
    asked for others; a color is NaN too where no surface was seen close by.
    """

    gradient: F32 | None
    occupancy: F32 | None
    state: U8 | None
    color: F32 | None

    def _is(self, value: int) -> Bool:
        if self.state is None:
            raise ValueError("ask for the field 'state' too")
        return np.asarray(self.state == value)

    @property
    def unknown(self) -> Bool:
        """Where nobody has seen what is there."""
        return self._is(UNKNOWN)

    @property
    def free(self) -> Bool:
        """Where there is nothing."""
        return self._is(FREE)

    @property
    def occupied(self) -> Bool:
        """Where there is something."""
        return self._is(OCCUPIED)


@dataclass(frozen=True, eq=False)
class Points(Columns):
    """The answer for points: distance (N,) m, gradient (N, 3), color (N, 3) sRGB, text_score (N,)."""

    distance: F32 | None
    text_score: F32 | None


def point_fields(fields: Iterable[Field] | None) -> list[query_pb2.PointField]:
    """The numbers of fields."""
    return [enum(query_pb2.PointField, "POINT_FIELD_", "fields", f) for f in fields or ()]


def wide(numbers: F32 | None) -> F32 | None:
    """x y z x y z … as rows."""
    return None if numbers is None else numbers.reshape(-1, 3)


def bytes_of(data: bytes) -> U8 | None:
    """A column of bytes."""
    return np.frombuffer(data, np.uint8).copy() if data else None


def text_to_wire(text: str | Text | None) -> language_pb2.Text | None:
    """Words alone, or all that a text may say."""
    if text is None:
        return None
    return (Text(text) if isinstance(text, str) else text).to_wire()


_REPLY = query_pb2.QueryPointsReply
_COLUMNS = {
    name: _REPLY.DESCRIPTOR.fields_by_name[name].number
    for name in ("distance_m", "gradient", "occupancy", "color", "text_score")
}


def read_points(data: bytes) -> Points:
    """The answer of a reply."""
    columns, rest = packed.split(data, _COLUMNS.values())
    reply = _REPLY.FromString(rest)
    return Points(
        distance=columns.get(_COLUMNS["distance_m"]),
        gradient=wide(columns.get(_COLUMNS["gradient"])),
        occupancy=columns.get(_COLUMNS["occupancy"]),
        state=bytes_of(reply.state),
        color=wide(columns.get(_COLUMNS["color"])),
        text_score=columns.get(_COLUMNS["text_score"]),
        **head(reply),
    )


def query_points(
    map_id: str,
    points: ArrayLike,
    *,
    fields: Iterable[Field] | None = None,
    text: str | Text | None = None,
    **terms: Unpack[Terms],
) -> Ask[Points]:
    """Distance, gradient, occupancy, state, color and how well a text fits, at (N, 3) points, m.

    Without fields all of them that the map has. All numbers come from one epoch.
    """
    request = query_pb2.QueryPointsRequest(
        map_id=map_id,
        fields=point_fields(fields),
        text=text_to_wire(text),
        **terms_to_wire(terms),
    )
    numbers = query_pb2.QueryPointsRequest.POINTS_M_FIELD_NUMBER
    return Ask(
        "Query/QueryPoints",
        "points",
        map_id,
        "QueryPointsRequest",
        packed.write(request, [(numbers, rows("points", points, 3))]),
        read_points,
        terms.get("timeout_s"),
    )
