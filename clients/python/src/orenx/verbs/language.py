"""Questions in words (language.proto)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from typing_extensions import Unpack

from .. import packed
from ..geometry import Box, box_to_wire, pose, rotation_of, rows, vector
from ..types import F32, F64, I32
from ..v1 import language_pb2
from . import Answer, Ask, Fresh, head, terms_to_wire
from .query import embeddings, words


@dataclass(frozen=True, eq=False)
class OrientedBox:
    """A box that stands upright and is turned about the vertical."""

    center: F64
    # world_from_box, 3x3.
    rotation: F64
    half_size: F64


@dataclass(frozen=True, eq=False)
class Match:
    """A thing: places that fit and hang together."""

    id: int
    score: float
    centroid: F64
    box: OrientedBox
    # Sides along the world's axes, m.
    extent: F64
    voxels: int
    # world_from_camera of the camera that showed it best, 4x4.
    best_view: F64 | None


@dataclass(frozen=True, eq=False)
class Matches(Answer):
    """Things, best first."""

    matches: list[Match]
    # The encoder of the map.
    encoder_id: str
    # If they were asked for: every place that fits, (K, 3), and its score (K,).
    places: F32 | None
    place_score: F32 | None

    @property
    def best(self) -> Match | None:
        """The first of them."""
        return self.matches[0] if self.matches else None


def _match(match: language_pb2.Match) -> Match:
    q = match.obb.rotation
    return Match(
        id=match.id,
        score=match.score,
        centroid=vector(match.centroid),
        box=OrientedBox(
            vector(match.obb.center),
            rotation_of([q.x, q.y, q.z, q.w]),
            vector(match.obb.half_size),
        ),
        extent=vector(match.extent),
        voxels=match.voxel_count,
        best_view=pose(match.best_view) if match.HasField("best_view") else None,
    )


_REPLY = language_pb2.QueryTextReply
_PLACES, _SCORES = _REPLY.PLACES_M_FIELD_NUMBER, _REPLY.PLACE_SCORE_FIELD_NUMBER


def _read_matches(data: bytes) -> Matches:
    columns, rest = packed.split(data, (_PLACES, _SCORES))
    reply = _REPLY.FromString(rest)
    places = columns.get(_PLACES)
    return Matches(
        matches=[_match(match) for match in reply.matches],
        encoder_id=reply.encoder_id,
        places=None if places is None else places.reshape(-1, 3),
        place_score=columns.get(_SCORES),
        **head(reply),
    )


def ask(
    map_id: str,
    prompts: str | Sequence[str],
    *,
    negatives: Sequence[str] | None = None,
    region: Box | ArrayLike | None = None,
    min_score: float | None = None,
    top_k: int = 0,
    places: bool = False,
    **fresh: Unpack[Fresh],
) -> Ask[Matches]:
    """Where in the map is what the words mean? As in ask("where is the blanket?")."""
    request = language_pb2.QueryTextRequest(
        map_id=map_id,
        region=None if region is None else box_to_wire("region", region),
        min_score=min_score,
        top_k=top_k,
        places=places,
        **words(prompts, negatives),
        **terms_to_wire(fresh, Fresh),
    )
    return Ask(
        "Language/QueryText",
        "text",
        map_id,
        "QueryTextRequest",
        request.SerializeToString(),
        _read_matches,
        fresh.get("timeout_s"),
    )


def ask_embedding(
    map_id: str,
    encoder_id: str,
    prompts: ArrayLike,
    *,
    negatives: ArrayLike | None = None,
    region: Box | ArrayLike | None = None,
    min_score: float | None = None,
    top_k: int = 0,
    places: bool = False,
    **fresh: Unpack[Fresh],
) -> Ask[Matches]:
    """The same with (K, D) embeddings of the map's encoder, of words or of pictures."""
    request = language_pb2.QueryEmbeddingRequest(
        map_id=map_id,
        encoder_id=encoder_id,
        prompts=embeddings("prompts", prompts),
        negatives=embeddings("negatives", negatives),
        region=None if region is None else box_to_wire("region", region),
        min_score=min_score,
        top_k=top_k,
        places=places,
        **terms_to_wire(fresh, Fresh),
    )
    return Ask(
        "Language/QueryEmbedding",
        "embedding",
        map_id,
        "QueryEmbeddingRequest",
        request.SerializeToString(),
        _read_matches,
        fresh.get("timeout_s"),
    )


@dataclass(frozen=True, eq=False)
class Classes(Answer):
    """The class of each point by its place in the question, -1 where nothing is known, and its cosine."""

    class_index: I32
    score: F32
    encoder_id: str


_CLASSIFY = language_pb2.ClassifyReply


def _read_classes(data: bytes) -> Classes:
    columns, rest = packed.split(data, (_CLASSIFY.SCORE_FIELD_NUMBER,))
    reply = _CLASSIFY.FromString(rest)
    # `class` is a word of Python's own.
    index: Any = getattr(reply, "class")
    return Classes(
        class_index=np.array(index, np.int32),
        score=columns.get(_CLASSIFY.SCORE_FIELD_NUMBER, np.zeros(0, np.float32)),
        encoder_id=reply.encoder_id,
        **head(reply),
    )


def classify(
    map_id: str,
    points: ArrayLike,
    classes: Sequence[str] = (),
    *,
    encoder_id: str = "",
    class_embeddings: ArrayLike | None = None,
    **fresh: Unpack[Fresh],
) -> Ask[Classes]:
    """Which of some classes is at each of (N, 3) points: by names, or by embeddings of an encoder."""
    request = language_pb2.ClassifyRequest(
        map_id=map_id,
        classes=list(classes),
        encoder_id=encoder_id,
        class_embeddings=embeddings("class_embeddings", class_embeddings),
        **terms_to_wire(fresh, Fresh),
    )
    field = language_pb2.ClassifyRequest.POINTS_M_FIELD_NUMBER
    return Ask(
        "Language/Classify",
        "classify",
        map_id,
        "ClassifyRequest",
        packed.write(request, [(field, rows("points", points, 3))]),
        _read_classes,
        fresh.get("timeout_s"),
    )


@dataclass(frozen=True)
class Encoder:
    """A name, and how many numbers its embeddings have."""

    encoder_id: str
    dimension: int


@dataclass(frozen=True, eq=False)
class Encoders(Answer):
    """What embeds words in the server, and what the map's features came from; None where there is none."""

    server: Encoder | None
    map: Encoder | None


def _read_encoders(data: bytes) -> Encoders:
    reply = language_pb2.ListEncodersReply.FromString(data)
    found = [
        Encoder(e.encoder_id, e.dimension) if there else None
        for e, there in (
            (reply.server, reply.HasField("server")),
            (reply.map, reply.HasField("map")),
        )
    ]
    return Encoders(server=found[0], map=found[1], **head(reply))


def encoders(map_id: str, *, timeout_s: float | None = None) -> Ask[Encoders]:
    """Which encoders the server and the map have."""
    request = language_pb2.ListEncodersRequest(map_id=map_id)
    return Ask(
        "Language/ListEncoders",
        "encoders",
        map_id,
        "ListEncodersRequest",
        request.SerializeToString(),
        _read_encoders,
        timeout_s,
    )
