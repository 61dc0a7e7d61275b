"""The axes of the map of behaviours, and the cell of a crash on them."""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from math import prod
from typing import get_args

from regents_cosim.attack_record import CollisionType
from regents_cosim.checks.names import did_you_mean
from regents_cosim.errors import RegentsError
from regents_cosim.runs.archive.crash import Crash
from regents_cosim.tags.table import TAGS, About

Cell = tuple[str, ...]  # one label per axis
_OTHER = "none"
# former names of axes, in settings of earlier versions
_FORMER_NAMES = {"tag": "manoeuvre", "kind": "collision_type"}


@dataclass(frozen=True)
class Axis:
    """One axis of a map."""

    name: str
    says: str
    labels: tuple[str, ...]  # all labels, in order
    of: Callable[[Crash], str]  # gives the label of a crash


def _tagged(name: str, about: About, says: str) -> Axis:
    """An axis that labels a case by the first of its tags about `about`, in the order of docs/tags.md."""
    tags = tuple(tag.name for tag in TAGS.values() if tag.about == about)
    return Axis(name, says, (*tags, _OTHER), lambda crash: next((tag for tag in tags if tag in crash.tags), _OTHER))


def _measured(
    name: str, says: str, edges: Sequence[int], unit: str, value: Callable[[Crash], float | None], unknown: str = ""
) -> Axis:
    """An axis that labels a crash by the bin of a value; `unknown` labels crashes without a value."""
    bounds = tuple(pairwise(edges))
    bins = (*(f"{low}-{high} {unit}" for low, high in bounds), f"{edges[-1]}+ {unit}")

    def label(crash: Crash) -> str:
        found = value(crash)
        return unknown if found is None else bins[max(bisect_right(edges, found) - 1, 0)]

    return Axis(name, says, (*bins, unknown) if unknown else bins, label)


AXES: dict[str, Axis] = {
    axis.name: axis
    for axis in (
        _tagged("manoeuvre", "adversary", "what the adversary does, by its first tag"),
        Axis("collision_type", "how the two meet", get_args(CollisionType), lambda crash: crash.collision_type),
        _measured(
            "closing_speed", "relative speed at the contact", (0, 5, 10, 15, 20), "m/s", lambda crash: crash.closing_m_s
        ),
        _measured(
            "departure",
            "time from when the adversary can be seen to leave its log to the contact",
            (0, 1, 2, 3, 4, 5, 6, 7),
            "s",
            lambda crash: crash.departs_s,
            "not seen",
        ),
        _tagged("ego", "ego", "what the ego does, by its first tag"),
        _tagged("place", "place", "where it happens"),
        _tagged("lights", "lights", "whether there are traffic lights"),
        _tagged("density", "density", "how dense the traffic is"),
    )
}
DEFAULT_AXES = ("manoeuvre", "closing_speed", "departure")


@dataclass(frozen=True)
class Axes:
    """The axes of one map. Raises RegentsError for no axis, an unknown one, and one given twice."""

    names: tuple[str, ...] = DEFAULT_AXES

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(_FORMER_NAMES.get(name, name) for name in self.names))
        if not self.names:
            raise RegentsError(f"`axes`: expected one or more of {', '.join(AXES)}")
        for at, name in enumerate(self.names):
            if name not in AXES:
                raise RegentsError(f"unknown axis {name!r}: {did_you_mean(name, AXES)}")
            if name in self.names[:at]:
                raise RegentsError(f"axis {name!r} is given twice: expected each once")

    @property
    def axes(self) -> list[Axis]:
        """The axes, in the given order."""
        return [AXES[name] for name in self.names]

    @property
    def count(self) -> int:
        """The number of cells, some of which no crash can fill."""
        return prod(len(axis.labels) for axis in self.axes)

    def cell(self, crash: Crash) -> Cell:
        """The cell of a crash."""
        return tuple(axis.of(crash) for axis in self.axes)

    def cells(self) -> list[Cell]:
        """All cells, in order."""
        return list(product(*(axis.labels for axis in self.axes)))


def parse_axes(text: str) -> Axes:
    """Read axes from text such as `manoeuvre,closing_speed`; the default for empty text. Raises RegentsError."""
    names = tuple(word.strip() for word in text.split(",") if word.strip())
    return Axes(names) if text else Axes()
