"""What the clients share of gRPC: channels, metadata, methods of raw bytes, errors."""

from __future__ import annotations

from typing import Any

import grpc

from .address import ENVELOPE_BYTES, MAX_MESSAGE_BYTES, Access, Grpc
from .errors import Error, InvalidArgumentError, UnavailableError, error_of
from .verbs import Ask

# What grpc.aio says where a write meets the end of its call; what the server said is lost then.
_WRITTEN_TOO_LATE = "Internal error from Core"

STREAM_FRAMES = "/orenx.v1.Ingest/StreamFrames"

OPTIONS: list[tuple[str, Any]] = [
    ("grpc.max_send_message_length", MAX_MESSAGE_BYTES + ENVELOPE_BYTES),
    ("grpc.max_receive_message_length", MAX_MESSAGE_BYTES + ENVELOPE_BYTES),
    # A server that went away is found again soon.
    ("grpc.initial_reconnect_backoff_ms", 250),
    ("grpc.max_reconnect_backoff_ms", 2000),
    # Clients of one process do not share connections: each has its own key and its own end.
    ("grpc.use_local_subchannel_pool", 1),
]


def credentials(address: Grpc, access: Access) -> grpc.ChannelCredentials | None:
    """What a TLS channel needs; None for a plain one."""
    if not address.secure:
        if access.has_tls():
            problem = "url: certificates are for grpcs://, and this is grpc://"
            raise InvalidArgumentError(problem, field="url")
        return None
    return grpc.ssl_channel_credentials(**access.pem())


def open_channel(address: Grpc, access: Access) -> grpc.Channel:
    """A channel for threads; it connects with its first call."""
    secret = credentials(address, access)
    if secret is None:
        return grpc.insecure_channel(address.target, options=OPTIONS)
    return grpc.secure_channel(address.target, secret, options=OPTIONS)


def path(ask: Ask[Any]) -> str:
    """The path of a method."""
    return f"/orenx.v1.{ask.method}"


def error_of_call(error: Any) -> Error:
    """The exception of a call that failed, of either kind of channel."""
    code = error.code()
    if error.details() == _WRITTEN_TOO_LATE:
        return UnavailableError("the server ended the stream while it was being written")
    return error_of(code.name if code is not None else "UNKNOWN", error.details() or str(code))


def options_of(access: Access, timeout_s: float | None) -> dict[str, Any]:
    """What goes with every call."""
    return {"metadata": access.metadata(), "timeout": timeout_s}
