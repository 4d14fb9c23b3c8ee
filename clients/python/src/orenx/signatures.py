"""Signatures of methods that are made of verbs, for help() and editors."""

from __future__ import annotations

import inspect
from typing import Any, Callable


def without_map(build: Callable[..., Any]) -> inspect.Signature:
    """That of a verb without its map_id, and with its answer."""
    signature = inspect.signature(build)
    parameters = list(signature.parameters.values())[1:]
    answer = str(signature.return_annotation)
    if answer.startswith("Ask[") and answer.endswith("]"):
        answer = answer[len("Ask[") : -1]
    return signature.replace(parameters=parameters, return_annotation=answer)
