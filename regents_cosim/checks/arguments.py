"""Checks of what a caller's own Python gives: known words, paths, and one thing where several may be given."""

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TypeVar

from regents_cosim.checks.names import did_you_mean
from regents_cosim.errors import RegentsError

_T = TypeVar("_T")
_SHOWN = 60  # characters of a value in a message


def require_one_of(value: object, known: Sequence[str], what: str) -> None:
    """Raise RegentsError unless `value` is one of the `known` words, which the argument `what` may have."""
    if value not in known:
        raise RegentsError(f"`{what}` {value!r}, {did_you_mean(str(value), known)}")


def as_path(value: Path | str, what: str) -> Path:
    """The path that the argument `what` has. Raises RegentsError for anything but a path or a text."""
    if not isinstance(value, str | os.PathLike):
        raise RegentsError(f"`{what}` is {_shown(value)}, expected a path")
    return Path(value)


def as_several(given: _T | Iterable[_T]) -> tuple[_T, ...]:
    """All of the given things; of a single text, path or other object a tuple of that one."""
    if isinstance(given, str) or not isinstance(given, Iterable):
        return (given,)  # pyright: ignore[reportReturnType]
    return tuple(given)


def require_a(kind: type[_T], value: object, hint: str) -> _T:
    """Return `value` if it is a `kind`, otherwise raise RegentsError with a `hint` at what to do."""
    if not isinstance(value, kind):
        raise RegentsError(f"{_shown(value)}, expected a {kind.__name__} ({hint})")
    return value


def _shown(value: object) -> str:
    text = repr(value)
    return f"a {type(value).__name__}, {text if len(text) <= _SHOWN else text[:_SHOWN] + ' ...'}"
