"""Images of a map from any place (render.proto)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import Unpack

from ..errors import InvalidArgumentError
from ..geometry import Intrinsics, pose_to_wire
from ..v1 import render_pb2
from . import Answer, Ask, Fresh, enum, enum_name, head, terms_to_wire
from .query import Text, text_to_wire

Output = Literal["color", "depth", "normal", "opacity", "unknown", "heat"]

_CHANNELS = {"color": 3, "normal": 3}
# What bytes say as well as floats do; the others come as f32.
_AS_BYTES = ("color", "unknown")


@dataclass(frozen=True, eq=False)
class Images(Answer):
    """Images of one epoch, by what they show.

    color [h, w, 3] u8 sRGB; depth [h, w] f32 m, 0 where there is no surface; normal [h, w, 3] f32; opacity
    [h, w] f32; unknown [h, w] bool; heat [h, w] f32, NaN where there is no score.
    """

    images: dict[str, NDArray[Any]]

    def __getitem__(self, output: Output) -> NDArray[Any]:
        """One of them, as in images["color"]."""
        return self.images[output]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        height, width = next(iter(self.images.values())).shape[:2]
        return width, height


def _read_images(data: bytes) -> Images:
    reply = render_pb2.RenderReply.FromString(data)
    images: dict[str, NDArray[Any]] = {}
    for image in reply.images:
        name = enum_name(render_pb2.ImageOutput, "IMAGE_OUTPUT_", image.output)
        bytewise = image.encoding == render_pb2.IMAGE_ENCODING_U8
        numbers = np.frombuffer(image.data, "u1" if bytewise else "<f4").copy()
        shape = (reply.height, reply.width, _CHANNELS.get(name, 1))
        numbers = numbers.reshape(shape)
        numbers = numbers[..., 0] if shape[2] == 1 else numbers
        images[name] = numbers.astype(np.bool_) if name == "unknown" else numbers
    return Images(images=images, **head(reply))


def render(
    map_id: str,
    world_from_camera: ArrayLike,
    intrinsics: Intrinsics,
    *,
    outputs: Sequence[Output] = ("color", "depth"),
    text: str | Text | None = None,
    renderer: Literal["tile", "ray"] = "tile",
    **fresh: Unpack[Fresh],
) -> Ask[Images]:
    """What a camera would see: color, depth, normal, opacity, unknown, or the heat of a text."""
    if isinstance(outputs, str):
        problem = f"outputs: '{outputs}' is no sequence of names"
        raise InvalidArgumentError(problem, field="outputs")
    images = [
        render_pb2.ImageRequest(
            output=enum(render_pb2.ImageOutput, "IMAGE_OUTPUT_", "outputs", output),
            encoding=render_pb2.IMAGE_ENCODING_U8
            if output in _AS_BYTES
            else render_pb2.IMAGE_ENCODING_F32,
        )
        for output in outputs
    ]
    request = render_pb2.RenderRequest(
        map_id=map_id,
        world_from_camera=pose_to_wire("world_from_camera", world_from_camera),
        intrinsics=intrinsics.to_wire(),
        images=images,
        renderer=enum(render_pb2.Renderer, "RENDERER_", "renderer", renderer),
        text=text_to_wire(text),
        **terms_to_wire(fresh, Fresh),
    )
    return Ask(
        "Render/Render",
        "render",
        map_id,
        "RenderRequest",
        request.SerializeToString(),
        _read_images,
        fresh.get("timeout_s"),
    )
