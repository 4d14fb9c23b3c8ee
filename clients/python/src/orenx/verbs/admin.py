"""What operators ask (admin.proto)."""

from __future__ import annotations

from ..v1 import admin_pb2
from . import Ask


def settings(*, timeout_s: float | None = None) -> Ask[str]:
    """The settings that the server runs on, TOML, without its keys."""
    request = admin_pb2.GetConfigRequest().SerializeToString()

    def read(data: bytes) -> str:
        return str(admin_pb2.GetConfigReply.FromString(data).toml)

    return Ask("Admin/GetConfig", None, "", "GetConfigRequest", request, read, timeout_s)


def set_log_level(level: str, *, timeout_s: float | None = None) -> Ask[str]:
    """Changes what the server writes to its log; the answer is what it was before."""
    request = admin_pb2.SetLogLevelRequest(level=level).SerializeToString()

    def read(data: bytes) -> str:
        return str(admin_pb2.SetLogLevelReply.FromString(data).before)

    return Ask("Admin/SetLogLevel", None, "", "SetLogLevelRequest", request, read, timeout_s)
