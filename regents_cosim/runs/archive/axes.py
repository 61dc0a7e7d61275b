"""The axes of the map of behaviours, and the cell of a crash on them."""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import prod

from regents_cosim.runs.archive.crash import Crash
from regents_cosim.tags.table import MANOEUVRES

Cell = tuple[str, ...]  # one label per axis
_OTHER = "none"


@dataclass(frozen=True)
class Axis:
    """One axis of the map."""

    name: str
    labels: tuple[str, ...]  # all labels, in order
    of: Callable[[Crash], str]  # gives the label of a crash


def _manoeuvre(crash: Crash) -> str:
    return next((tag for tag in MANOEUVRES if tag in crash.tags), _OTHER)


def _measured(
    name: str, edges: Sequence[int], unit: str, value: Callable[[Crash], float | None], unknown: str = ""
) -> Axis:
    """An axis that labels a crash by the bin of a value; `unknown` labels crashes without a value."""
    bounds = tuple(pairwise(edges))
    bins = (*(f"{low}-{high} {unit}" for low, high in bounds), f"{edges[-1]}+ {unit}")

    def label(crash: Crash) -> str:
        found = value(crash)
        return unknown if found is None else bins[max(bisect_right(edges, found) - 1, 0)]

    return Axis(name, (*bins, unknown) if unknown else bins, label)


AXES = (
    Axis("manoeuvre", (*MANOEUVRES, _OTHER), _manoeuvre),
    _measured("closing_speed", (0, 5, 10, 15, 20), "m/s", lambda crash: crash.closing_m_s),
    _measured("departure", range(8), "s", lambda crash: crash.departs_s, "not seen"),
)
NAMES = tuple(axis.name for axis in AXES)
CELLS = prod(len(axis.labels) for axis in AXES)  # number of cells, some of which no crash can fill


def cell_of(crash: Crash) -> Cell:
    """The cell of a crash."""
    return tuple(axis.of(crash) for axis in AXES)
