"""What a planner thought, as a message of bounded size: from `Debug`, and back."""

from collections.abc import Sequence
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta

from regents_cosim.checks.typed_values import from_values
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
    """What a planner gave, checked. Raises TypeError or ValueError with what was expected."""
    told = {
        "candidates": _points(debug.candidates, "candidates"),
        "costs": [float(cost) for cost in debug.costs],
        "chosen": None if debug.chosen is None else _plain(debug.chosen, "chosen"),
        "predictions": _points(debug.predictions, "predictions"),
        "text": debug.text,
    }
    try:
        made = from_values(told, DebugMessage)
    except msgspec.ValidationError as error:
        raise ValueError(f"debug: {error}") from None
    _ = made.debug
    return made


def _points(paths: Sequence[Any], name: str) -> list[Any]:
    return [_plain(path, name) for path in paths]


def _plain(points: Any, name: str) -> list[Any]:
    path = np.asarray(points, float)
    if path.ndim != 2 or path.shape[1] != 2:
        raise ValueError(f"debug.{name}: a path of shape {list(path.shape)}, expected [point, 2]")
    return path.tolist()
