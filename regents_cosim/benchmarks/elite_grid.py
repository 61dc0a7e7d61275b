"""The best change in each cell of a grid, and what another one adds to it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

Change = Float[np.ndarray, " coordinate"]
Changes = Float[np.ndarray, "change coordinate"]
Cell = tuple[int, ...]


class Gain(NamedTuple):
    """What a change adds; the greater the more: a new cell before a better change in an old one."""

    new_cell: bool
    value: float  # in a new cell its own, else by how much it is better than the best there

    @property
    def adds(self) -> bool:
        """Whether it was taken in."""
        return self.new_cell or self.value > 0.0


@dataclass
class EliteGrid:
    """Changes by cell, each with its value."""

    cells: dict[Cell, tuple[float, Change]] = field(default_factory=dict)

    def add(self, cell: Cell, value: float, change: Change) -> Gain:
        """Take a change in if it is the best there."""
        best = self.cells.get(cell)
        if best is None or value > best[0]:
            self.cells[cell] = (value, change)
        return Gain(True, value) if best is None else Gain(False, value - best[0])

    def draw(self, rng: np.random.Generator, otherwise: Change) -> Change:
        """One of its changes; what is said where it has none."""
        changes = [change for _, change in self.cells.values()] or [otherwise]
        return changes[rng.integers(len(changes))]


def ranks(gains: Sequence[Gain]) -> list[float]:
    """The place of each, 0 for what adds most."""
    places = [0.0] * len(gains)
    for place, at in enumerate(sorted(range(len(gains)), key=gains.__getitem__, reverse=True)):
        places[at] = float(place)
    return places
