"""What a planner thought, as a message of bounded size: from `Debug`, and back."""

import sys
from functools import cache
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta

from regents_cosim.planners.interface import MOST_LETTERS, MOST_PATHS, MOST_POINTS, Debug, Path

_Line = Annotated[list[tuple[float, float]], Meta(max_length=MOST_POINTS)]
_Lines = Annotated[list[_Line], Meta(max_length=MOST_PATHS)]


class DebugMessage(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    """The fields of `Debug` as plain lists."""

    candidates: _Lines = []
    costs: Annotated[list[float], Meta(max_length=MOST_PATHS)] = []
    chosen: _Line | None = None
    predictions: _Lines = []
    text: Annotated[str, Meta(max_length=MOST_LETTERS)] = ""

    @property
    def sound(self) -> bool:
        """Whether `debug` gives values; who sends it may be tampered with."""
        try:
            return isinstance(self.debug, Debug)
        except ValueError:
            return False

    @property
    def debug(self) -> Debug:
        """The values. Raises ValueError where a number is not finite, or the costs are not one for each candidate."""
        if self.costs and len(self.costs) != len(self.candidates):
            raise ValueError(f"debug.costs: {len(self.costs)}, expected one for each of {len(self.candidates)} paths")
        if not np.isfinite(self.costs).all():
            raise ValueError("debug.costs: not finite, expected finite numbers")
        chosen = None if self.chosen is None else _array(self.chosen)
        return Debug(
            tuple(map(_array, self.candidates)),
            tuple(self.costs),
            chosen,
            tuple(map(_array, self.predictions)),
            self.text,
        )


def _array(points: list[tuple[float, float]]) -> Path:
    path = np.array(points, float).reshape(-1, 2)
    if not np.isfinite(path).all():
        raise ValueError("debug: a point is not finite, expected finite numbers [m]")
    return path


def debug_message(debug: Debug) -> DebugMessage:
    """What a planner gave, checked, and cut to what is kept. Raises TypeError or ValueError with what was expected."""
    candidates, costs, predictions = (
        _kept(getattr(debug, name), name, MOST_PATHS) for name in ("candidates", "costs", "predictions")
    )
    if not isinstance(debug.text, str):
        raise TypeError(f"debug.text is a {type(debug.text).__name__}, expected a text")
    made = DebugMessage(
        [_plain(path, "candidates", 2) for path in candidates],
        _plain(costs, "costs", 1),
        None if debug.chosen is None else _plain(debug.chosen, "chosen", 2),
        [_plain(path, "predictions", 2) for path in predictions],
        "".join(_kept(debug.text, "text", MOST_LETTERS)).encode(errors="replace").decode(),
    )
    _ = made.debug
    return made


def _kept(values: Any, name: str, most: int) -> list[Any]:
    """The first `most` values."""
    try:
        every = list(values)
    except TypeError:
        raise TypeError(f"debug.{name} is a {type(values).__name__}, expected a list") from None
    if len(every) > most:
        _say_that_it_is_cut()
    return every[:most]


def _plain(numbers: Any, name: str, dimensions: int) -> list[Any]:
    """A path as [(x, y), ...], or with one dimension a list of numbers."""
    expected = "expected numbers of shape [point, 2]" if dimensions == 2 else "expected a list of numbers"
    try:
        made = np.asarray(numbers, float)
    except (TypeError, ValueError):  # NumPy's own words do not say of what
        raise ValueError(f"debug.{name}: not made of numbers, or with rows of different lengths, {expected}") from None
    if made.ndim != dimensions or made.shape[1:] not in ((), (2,)):
        raise ValueError(f"debug.{name}: shape {list(made.shape)}, {expected}")
    if not np.isfinite(made).all():
        raise ValueError(f"debug.{name}: not finite, {expected} that are finite")
    kept = _kept(made.tolist(), name, MOST_POINTS)
    return [tuple(point) for point in kept] if dimensions == 2 else kept


@cache
def _say_that_it_is_cut() -> None:
    """Once in a process."""
    limits = f"{MOST_PATHS} paths of each kind, {MOST_POINTS} points of a path and {MOST_LETTERS} letters"
    print(f"regents: the planner's `debug` is cut to {limits}", file=sys.stderr)
