"""Check that a number is finite, within bounds, and whole where it counts something."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from regents_cosim.errors import RegentsError


@dataclass(frozen=True)
class Range:
    """A range of numbers, ends included, with a description for error messages."""

    least: float
    most: float
    what: str  # description with unit and the meaning of the ends
    whole: bool = False

    def check(self, name: str, value: float) -> None:
        """Raise RegentsError unless `value` lies in the range; NaN never does."""
        kind = "a whole number" if self.whole else "a number"
        if isinstance(value, bool) or not _is_number(value) or (self.whole and value != int(value)):
            said = repr(value) if isinstance(value, str) else value
            raise RegentsError(f"{name} is {said}, expected {kind}: {self.what}")
        if not self.least <= value <= self.most:
            raise RegentsError(f"{name} is {value}, expected {self.least:g} to {self.most:g}: {self.what}")


SEED = Range(0, 2**31 - 1, "the seed of everything random, as large as SUMO takes it", whole=True)


def check_ranges(values: object, ranges: Mapping[str, Range]) -> None:
    """Raise RegentsError for the first attribute of `values` that is outside its range."""
    for name, one in ranges.items():
        one.check(name, getattr(values, name))


def _is_number(value: object) -> bool:
    try:
        return math.isfinite(value)  # type: ignore[arg-type]
    except (TypeError, OverflowError):
        return False
