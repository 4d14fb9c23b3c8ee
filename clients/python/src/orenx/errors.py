"""What goes wrong, as exceptions: each carries the code of the wire, the field and the message."""

from __future__ import annotations


class Error(Exception):
    """What the server, or the way to it, says instead of an answer."""

    code: str = "UNKNOWN"

    def __init__(self, message: str, *, field: str | None = None, code: str | None = None):
        """The field is the one at fault, as in `points_m[3].x`, where one is."""
        super().__init__(message)
        self.message = message
        self.field = field
        if code is not None:
            self.code = code


class InvalidArgumentError(Error, ValueError):
    """The question is wrong whatever the map holds."""

    code = "INVALID_ARGUMENT"


class NotFoundError(Error, LookupError):
    """There is no such map, snapshot or robot."""

    code = "NOT_FOUND"


class FailedPreconditionError(Error):
    """The map is not as the question wants it: too old, of another encoder, there already."""

    code = "FAILED_PRECONDITION"


class ResourceExhaustedError(Error):
    """A bound was reached; the message says which."""

    code = "RESOURCE_EXHAUSTED"


class UnavailableError(Error, ConnectionError):
    """Nobody answers, or the server loads or stops."""

    code = "UNAVAILABLE"


class DeadlineExceededError(Error, TimeoutError):
    """No answer came within the time that was given."""

    code = "DEADLINE_EXCEEDED"


class UnauthenticatedError(Error, PermissionError):
    """No API key, or one that the server does not know."""

    code = "UNAUTHENTICATED"


class PermissionDeniedError(Error, PermissionError):
    """The API key is not for this."""

    code = "PERMISSION_DENIED"


class CancelledError(Error):
    """The stream or question was given up."""

    code = "CANCELLED"


_CLASSES = {
    kind.code: kind
    for kind in (
        InvalidArgumentError,
        NotFoundError,
        FailedPreconditionError,
        ResourceExhaustedError,
        UnavailableError,
        DeadlineExceededError,
        UnauthenticatedError,
        PermissionDeniedError,
        CancelledError,
    )
}

# The codes of gRPC by number, as QueryError has them.
_NAMES = [
    "OK",
    "CANCELLED",
    "UNKNOWN",
    "INVALID_ARGUMENT",
    "DEADLINE_EXCEEDED",
    "NOT_FOUND",
    "ALREADY_EXISTS",
    "PERMISSION_DENIED",
    "RESOURCE_EXHAUSTED",
    "FAILED_PRECONDITION",
    "ABORTED",
    "OUT_OF_RANGE",
    "UNIMPLEMENTED",
    "INTERNAL",
    "UNAVAILABLE",
    "DATA_LOSS",
    "UNAUTHENTICATED",
]


def error_of(code: str, message: str, field: str | None = None) -> Error:
    """The exception of a code by its name."""
    if code == "OUT_OF_RANGE":
        code = "INVALID_ARGUMENT"
    if field is None and code == "INVALID_ARGUMENT":
        # gRPC carries one text, which begins with the field.
        head, found, _ = message.partition(": ")
        if found and " " not in head:
            field = head
    kind = _CLASSES.get(code, Error)
    return kind(message, field=field or None, code=code)


def error_of_number(code: int, message: str, field: str | None = None) -> Error:
    """The exception of a code by its number."""
    name = _NAMES[code] if 0 <= code < len(_NAMES) else "UNKNOWN"
    return error_of(name, message, field)
