"""Client of the orenx map server: numpy in, numpy out.

    client = orenx.connect("grpc://127.0.0.1:7610")
    m = client.map("default")
    answer = m.query_points([[0.5, -1.0, 0.8]])

`orenx.aio` has the same for asyncio, `orenx.recordings` reads folders of recorded frames, and
`orenx.viewer` shows a map in rerun.
"""

from .books import StreamReport
from .client import Client, Map, Watch, connect
from .errors import (
    CancelledError,
    DeadlineExceededError,
    Error,
    FailedPreconditionError,
    InvalidArgumentError,
    NotFoundError,
    PermissionDeniedError,
    ResourceExhaustedError,
    UnauthenticatedError,
    UnavailableError,
)
from .frames import Ack, Features, Frame, Labels
from .geometry import Box, Intrinsics, look_at
from .stream import FrameStream
from .verbs import Answer
from .verbs.edits import Edit, Mesh, SolidBox, Sphere
from .verbs.language import Classes, Encoder, Encoders, Match, Matches, OrientedBox
from .verbs.maps import FrameCounts, MapInfo, MapStats, MapSummary, Reset, Robot, Storage
from .verbs.planner import Grid, Nearest, Place, Rays, Slice, Spheres, Verdict, Verdicts
from .verbs.query import FREE, OCCUPIED, UNKNOWN, Points, Text
from .verbs.render import Images
from .verbs.snapshots import Snapshot
from .verbs.watch import Brick, RegionUpdate

__all__ = [
    "FREE",
    "OCCUPIED",
    "UNKNOWN",
    "Ack",
    "Answer",
    "Box",
    "Brick",
    "CancelledError",
    "Classes",
    "Client",
    "DeadlineExceededError",
    "Edit",
    "Encoder",
    "Encoders",
    "Error",
    "FailedPreconditionError",
    "Features",
    "Frame",
    "FrameCounts",
    "FrameStream",
    "Grid",
    "Images",
    "Intrinsics",
    "InvalidArgumentError",
    "Labels",
    "Map",
    "MapInfo",
    "MapStats",
    "MapSummary",
    "Match",
    "Matches",
    "Mesh",
    "Nearest",
    "NotFoundError",
    "OrientedBox",
    "PermissionDeniedError",
    "Place",
    "Points",
    "Rays",
    "RegionUpdate",
    "Reset",
    "ResourceExhaustedError",
    "Robot",
    "Slice",
    "Snapshot",
    "SolidBox",
    "Sphere",
    "Spheres",
    "Storage",
    "StreamReport",
    "Text",
    "UnauthenticatedError",
    "UnavailableError",
    "Verdict",
    "Verdicts",
    "Watch",
    "connect",
    "look_at",
]
