"""A grid with the best proposal of each cell, and what another proposal adds to it.

Accepted crashes come before everything else: near misses only show the way while there is no crash.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

Change = Float[np.ndarray, " coordinate"]
Cell = tuple[int, ...]


class Proposal(NamedTuple):
    """A change of one of the starts of a search, to be tried."""

    start: int
    change: Change


class Elite(NamedTuple):
    """The best proposal of a cell: crashes before all others, then the greater value."""

    crash: bool
    value: float
    proposal: Proposal


class Gain(NamedTuple):
    """What a proposal adds to the grid; gains compare by first crash of a cell, new cell, then value."""

    first_crash: bool
    new_cell: bool
    value: float  # the own value in a new cell, otherwise the improvement
    adds: bool  # whether a search should continue from it


@dataclass
class EliteGrid:
    """The best proposals by cell."""

    cells: dict[Cell, Elite] = field(default_factory=dict)
    crashes: int = 0  # number of cells with a crash

    def add(self, cell: Cell, one: Elite) -> Gain:
        """Add a proposal if it is the best of its cell; returns the gain."""
        best = self.cells.get(cell)
        better = best is None or one[:2] > best[:2]
        if better:
            self.cells[cell] = one
        first_crash = one.crash and (best is None or not best.crash)
        self.crashes += first_crash
        value = one.value - best.value if best is not None and best.crash == one.crash else one.value
        return Gain(first_crash, best is None, value, better and (one.crash or not self.crashes))

    def draw(self, rng: np.random.Generator, otherwise: Proposal) -> Proposal:
        """A random proposal that crashes, or any if none does; `otherwise` where the grid is empty."""
        found = [one.proposal for one in self.cells.values() if one.crash or not self.crashes] or [otherwise]
        return found[rng.integers(len(found))]


def ranks(gains: Sequence[Gain]) -> list[float]:
    """The rank of each gain, 0 for the greatest."""
    places = [0.0] * len(gains)
    for place, at in enumerate(sorted(range(len(gains)), key=gains.__getitem__, reverse=True)):
        places[at] = float(place)
    return places
