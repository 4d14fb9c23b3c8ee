"""URLs of servers, and what is needed to reach them."""

from __future__ import annotations

import pathlib
from dataclasses import dataclass
from typing import Union

from .errors import InvalidArgumentError

# The largest message of the interface, and what stands around it.
MAX_MESSAGE_BYTES = 64 << 20
ENVELOPE_BYTES = 1 << 20

Pem = Union[None, str, bytes, "pathlib.Path"]


@dataclass(frozen=True)
class Grpc:
    """A server over gRPC."""

    target: str
    secure: bool


@dataclass(frozen=True)
class Zenoh:
    """A network of Zenoh: an endpoint, or a file of configuration."""

    endpoint: str | None
    config: str | None
    prefix: str


@dataclass(frozen=True)
class Access:
    """Who we are, and whom we trust. PEM as bytes, or the path of a file."""

    api_key: str | None = None
    ca: Pem = None
    cert: Pem = None
    key: Pem = None

    def metadata(self) -> tuple[tuple[str, str], ...]:
        """What goes with every call."""
        return (("api-key", self.api_key),) if self.api_key else ()

    def has_tls(self) -> bool:
        """Whether any certificate is given."""
        return any(part is not None for part in (self.ca, self.cert, self.key))

    def pem(self) -> dict[str, bytes | None]:
        """The certificates, in the words of grpc.ssl_channel_credentials."""
        if (self.cert is None) != (self.key is None):
            raise InvalidArgumentError("cert, key: one without the other", field="cert")
        return {
            "root_certificates": _read("ca", self.ca),
            "private_key": _read("key", self.key),
            "certificate_chain": _read("cert", self.cert),
        }


def _read(field: str, pem: Pem) -> bytes | None:
    if pem is None or isinstance(pem, bytes):
        return pem
    try:
        return pathlib.Path(pem).read_bytes()
    except OSError as error:
        raise InvalidArgumentError(f"{field}: {error}", field=field) from None


def read_url(url: str) -> Grpc | Zenoh:
    """grpc://host:port, grpcs://host:port, zenoh+tcp://host:port[/prefix], zenoh+file:PATH[#prefix]."""
    scheme, found, rest = url.partition("://")
    if url.startswith("zenoh+file:"):
        path, _, prefix = url[len("zenoh+file:") :].partition("#")
        if path:
            return Zenoh(None, path, prefix or "orenx")
    elif found and rest and scheme in ("grpc", "grpcs"):
        host = rest.rstrip("/")
        if "/" not in host:
            return Grpc(host, scheme == "grpcs")
    elif found and scheme in ("zenoh+tcp", "zenoh+udp", "zenoh+tls"):
        host, _, prefix = rest.partition("/")
        if host:
            return Zenoh(f"{scheme[len('zenoh+') :]}/{host}", None, prefix.rstrip("/") or "orenx")
    ways = "grpc://host:7610, grpcs://host:7610, zenoh+tcp://host:7447 or zenoh+file:PATH"
    raise InvalidArgumentError(f"url: '{url}' is none of {ways}", field="url")
