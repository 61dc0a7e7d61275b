"""The best proposal in each cell of a grid, and what another one adds to it.

A crash that is accepted comes before anything else: near misses only show the way while there is none.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

Change = Float[np.ndarray, " coordinate"]
Cell = tuple[int, ...]


class Proposal(NamedTuple):
    """What is to be tried: a change of one of the drives that a search may begin with."""

    start: int
    change: Change


class Elite(NamedTuple):
    """The best of a cell: crashes before all others, then the greater value."""

    crash: bool
    value: float
    proposal: Proposal


class Gain(NamedTuple):
    """What a proposal adds; the greater the more: a cell's first crash, then a new cell, then a better one."""

    first_crash: bool
    new_cell: bool
    value: float  # in a new cell its own, else by how much it is better than the best there
    adds: bool  # whether to go on from it


@dataclass
class EliteGrid:
    """Proposals by cell."""

    cells: dict[Cell, Elite] = field(default_factory=dict)
    crashes: int = 0  # cells with one

    def add(self, cell: Cell, one: Elite) -> Gain:
        """Take a proposal in if it is the best there."""
        best = self.cells.get(cell)
        better = best is None or one[:2] > best[:2]
        if better:
            self.cells[cell] = one
        first_crash = one.crash and (best is None or not best.crash)
        self.crashes += first_crash
        value = one.value - best.value if best is not None and best.crash == one.crash else one.value
        return Gain(first_crash, best is None, value, better and (one.crash or not self.crashes))

    def draw(self, rng: np.random.Generator, otherwise: Proposal) -> Proposal:
        """One that crashes, else any; what is said where it has none."""
        found = [one.proposal for one in self.cells.values() if one.crash or not self.crashes] or [otherwise]
        return found[rng.integers(len(found))]


def ranks(gains: Sequence[Gain]) -> list[float]:
    """The place of each, 0 for what adds most."""
    places = [0.0] * len(gains)
    for place, at in enumerate(sorted(range(len(gains)), key=gains.__getitem__, reverse=True)):
        places[at] = float(place)
    return places
