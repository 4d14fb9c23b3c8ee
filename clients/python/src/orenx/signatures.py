"""Methods that are made of verbs: each verb's parameters are written once, for both clients."""

from __future__ import annotations

import inspect
from functools import partial, update_wrapper
from typing import Any, Callable, Generic, Protocol, TypeVar, overload

from typing_extensions import Concatenate, ParamSpec

from .verbs import Ask

P = ParamSpec("P")
R = TypeVar("R")


class OfMap(Protocol):
    """What is a map of a client."""

    map_id: str
    _client: Any


class Method(Generic[P, R]):
    """A method of a map that sends what a verb says."""

    def __init__(
        self,
        build: Callable[Concatenate[str, P], Ask[Any]],
        send: Callable[[Any, Callable[[], Ask[Any]]], R],
        answer: str = "{}",
    ):
        """`send` gets the client and what makes the question; `answer` is how help() names its type."""
        self._build = build
        self._send = send
        self.__doc__ = build.__doc__
        self.__signature__ = _without_map(build, answer)

    @overload
    def __get__(self, of: None, owner: type) -> Method[P, R]: ...
    @overload
    def __get__(self, of: OfMap, owner: type) -> Callable[P, R]: ...
    def __get__(self, of: OfMap | None, owner: type) -> Any:
        """The method, of one map."""
        if of is None:
            return self

        def method(*args: P.args, **kwargs: P.kwargs) -> R:
            return self._send(of._client, partial(self._build, of.map_id, *args, **kwargs))

        update_wrapper(method, self._build)
        method.__signature__ = self.__signature__  # type: ignore[attr-defined]
        return method


def _without_map(build: Callable[..., Any], answer: str) -> inspect.Signature:
    """The signature of a verb without its map_id, and with its answer."""
    signature = inspect.signature(build)
    parameters = list(signature.parameters.values())[1:]
    read = str(signature.return_annotation)
    if read.startswith("Ask[") and read.endswith("]"):
        read = answer.format(read[len("Ask[") : -1])
    return signature.replace(parameters=parameters, return_annotation=read)
