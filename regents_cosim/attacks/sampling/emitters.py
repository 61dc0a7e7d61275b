"""CMA-ME: proposes changes in a search for diverse crashes, and learns from what they add to a grid.

Source: Fontaine et al. 2020, "Covariance Matrix Adaptation for the Rapid Illumination of Behavior Space" (its
improvement emitter). One thing differs from the paper: CMA-ES learns from the better half of a batch, even if fewer of
its changes added something.

It is built on the package `cmaes`; pyribs 0.12, which has it, also needs numba, scikit-learn and pandas.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float

if TYPE_CHECKING:
    from cmaes import CMA

# A grid with the best proposal of each cell, and what another proposal adds to it.
# Accepted crashes come before everything else: near misses only show the way while there is no crash.
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


BATCH = 10  # changes per batch: CMA-ES's own choice for ten coordinates
_SPREAD = 0.5  # initial spread, as of CMA-ES in `attacks.sampling.sampled_search`


class CmaMe:
    """CMA-ES that ranks changes by what they add; where they add nothing, it restarts at an elite."""

    def __init__(self, grid: EliteGrid, size: int, seed: int) -> None:
        self._grid, self._rng, self._none = grid, np.random.default_rng(seed), Proposal(0, np.zeros(size))
        self._begin()

    def ask(self) -> list[Proposal]:
        """Propose a generation of changes."""
        return [Proposal(self._start, self._cma.ask()) for _ in range(BATCH)]

    def tell(self, tried: Sequence[Proposal], gains: Sequence[Gain]) -> None:
        """Move to where most was added."""
        changes = [one.change for one in tried]
        self._cma.tell(list(zip(changes, ranks(gains), strict=True)))
        if self._cma.should_stop() or not any(gain.adds for gain in gains):
            self._begin()

    def _begin(self) -> None:
        self._start, mean = self._grid.draw(self._rng, self._none)
        self._cma = cma_es(mean, _SPREAD, BATCH, int(self._rng.integers(2**31)))


# CMA-ES (Hansen 2016, "The CMA Evolution Strategy: A Tutorial") comes from the package `cmaes`, imported in a fifth of
# the usual time.
_NOT_NEEDED = "scipy.stats"  # most of the import time; only an unused variant needs it


def cma_es(mean: Float[np.ndarray, " coordinate"], spread: float, population: int, seed: int) -> "CMA":
    """A CMA-ES search around `mean`, with `population` changes per generation."""
    if _NOT_NEEDED in sys.modules:
        from cmaes import CMA
    else:
        sys.modules[_NOT_NEEDED] = None  # pyright: ignore[reportArgumentType]  to Python one that is not installed
        try:
            from cmaes import CMA
        finally:
            del sys.modules[_NOT_NEEDED]
    return CMA(mean=mean, sigma=spread, population_size=population, seed=seed)
