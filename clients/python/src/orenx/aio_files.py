"""As `files`, for a loop of asyncio: what blocks on a disk is left to a thread."""

from __future__ import annotations

import asyncio
import pathlib
from typing import Any, TypeVar

import grpc
import grpc.aio

from . import files, over_grpc
from .address import Access
from .files import Incoming, Path
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


async def upload(channel: grpc.Channel, access: Access, ask: Ask[A], path: Path) -> A:
    """Sends a file over a channel for threads, which it closes.

    One of grpc.aio would not tell why a server ends an upload that is being written.
    """
    try:
        return await asyncio.to_thread(files.upload, channel, access, ask, path)
    finally:
        channel.close()
