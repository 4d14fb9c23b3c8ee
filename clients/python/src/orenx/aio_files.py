"""As `files`, for a loop of asyncio: what blocks on a disk is left to a thread."""

from __future__ import annotations

import asyncio
import pathlib
from collections.abc import AsyncIterator, Iterator
from typing import Any, TypeVar

import grpc.aio

from . import over_grpc
from .address import Access
from .files import Incoming, Path, outgoing
from .verbs import Ask
from .verbs.snapshots import Piece

A = TypeVar("A")


async def download(
    channel: grpc.aio.Channel, access: Access, ask: Ask[Piece], path: Path
) -> pathlib.Path:
    """Fetches a file."""
    method: Any = channel.unary_stream(over_grpc.path(ask))
    with await asyncio.to_thread(Incoming, path) as file:
        call = method(ask.request, **over_grpc.options_of(access, ask.timeout_s))
        try:
            async for data in call:
                await asyncio.to_thread(file.write, ask.read(data))
        except grpc.RpcError as error:
            raise over_grpc.error_of_call(error) from None
        finally:
            call.cancel()
        return await asyncio.to_thread(file.finish)


async def upload(channel: grpc.aio.Channel, access: Access, ask: Ask[A], path: Path) -> A:
    """Sends a file."""
    method: Any = channel.stream_unary(over_grpc.path(ask))
    with await asyncio.to_thread(pathlib.Path(path).open, "rb") as file:
        messages = _from_a_thread(outgoing(ask.request, file))
        try:
            reply = await method(messages, **over_grpc.options_of(access, ask.timeout_s))
        except grpc.RpcError as error:
            raise over_grpc.error_of_call(error) from None
    return ask.read(reply)


async def _from_a_thread(messages: Iterator[bytes]) -> AsyncIterator[bytes]:
    while (message := await asyncio.to_thread(next, messages, None)) is not None:
        yield message
