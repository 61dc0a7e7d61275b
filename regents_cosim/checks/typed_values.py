"""JSON and plain values as dataclasses, in any thread.

msgspec keeps what it learns of a dataclass on the class before it is complete. Two threads that need the same class for
the first time end the process by a segmentation fault (seen in msgspec 0.22). So one thread at a time learns.
"""

from functools import cache
from threading import Lock
from typing import Any, TypeVar

import msgspec

_Kind = TypeVar("_Kind")
_learning = Lock()


def from_json(text: bytes, kind: type[_Kind]) -> _Kind:
    """JSON as a value of `kind`. Raises msgspec.MsgspecError where it is no such value."""
    return _learnt(kind).decode(text)


def from_values(values: Any, kind: type[_Kind]) -> _Kind:
    """Dictionaries, lists, numbers and texts as a value of `kind`. Raises msgspec.MsgspecError if they are no such."""
    _learnt(kind)
    return msgspec.convert(values, kind)


def _learnt(kind: type[_Kind]) -> msgspec.json.Decoder[_Kind]:
    with _learning:
        return _decoder(kind)


@cache
def _decoder(kind: type[_Kind]) -> msgspec.json.Decoder[_Kind]:
    return msgspec.json.Decoder(kind)
