"""Files that come from a server, and go to it: piece by piece, never whole in memory."""

from __future__ import annotations

import os
import pathlib
import uuid
from collections.abc import Iterator
from typing import IO, Any, TypeVar, Union

import grpc

from . import over_grpc
from .address import Access
from .errors import Error
from .verbs import Ask
from .verbs.snapshots import Piece, upload_piece

A = TypeVar("A")

Path = Union[str, "os.PathLike[str]"]

# Bytes of a file in one message.
_PIECE_BYTES = 1 << 20


class Incoming:
    """A file that is written beside its place, and gets its name once every byte is there."""

    def __init__(self, path: Path):
        """Begins; what is at the path stays until the end."""
        self._path = pathlib.Path(path)
        self._part = self._path.with_name(f".{self._path.name}.{uuid.uuid4().hex}.part")
        self._file = self._part.open("xb")
        self._expected: int | None = None
        self._came = 0

    def write(self, piece: Piece) -> None:
        """The next bytes."""
        self._expected = piece.file_bytes if self._expected is None else self._expected
        self._came += len(piece.data)
        self._file.write(piece.data)

    def finish(self) -> pathlib.Path:
        """Gives it its name."""
        if self._came != self._expected:
            problem = f"{self._came} of {self._expected} bytes came"
            raise Error(f"{self._path}: {problem}", code="DATA_LOSS")
        self._file.close()
        self._part.replace(self._path)
        return self._path

    def __enter__(self) -> Incoming:
        """Itself."""
        return self

    def __exit__(self, *_: Any) -> None:
        """Leaves nothing of a file that has no name yet."""
        self._file.close()
        self._part.unlink(missing_ok=True)


def outgoing(begin: bytes, file: IO[bytes]) -> Iterator[bytes]:
    """The messages of an upload."""
    yield begin
    while True:
        try:
            data = file.read(_PIECE_BYTES)
        except ValueError:  # closed: the server refused before it heard all
            return
        if not data:
            return
        yield upload_piece(data)


def download(channel: grpc.Channel, access: Access, ask: Ask[Piece], path: Path) -> pathlib.Path:
    """Fetches a file."""
    method: Any = channel.unary_stream(over_grpc.path(ask))
    with Incoming(path) as file:
        call = method(ask.request, **over_grpc.options_of(access, ask.timeout_s))
        try:
            for data in call:
                file.write(ask.read(data))
        except grpc.RpcError as error:
            raise over_grpc.error_of_call(error) from None
        finally:
            call.cancel()
        return file.finish()


def upload(channel: grpc.Channel, access: Access, ask: Ask[A], path: Path) -> A:
    """Sends a file."""
    method: Any = channel.stream_unary(over_grpc.path(ask))
    with pathlib.Path(path).open("rb") as file:
        messages = outgoing(ask.request, file)
        try:
            reply = method(messages, **over_grpc.options_of(access, ask.timeout_s))
        except grpc.RpcError as error:
            raise over_grpc.error_of_call(error) from None
    return ask.read(reply)
