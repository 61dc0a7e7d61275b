"""Emitters that propose changes in a search for diverse crashes: at random, by CMA-ME, or by CMA-MEGA.

They learn from what their changes add to a grid. Sources: Fontaine et al. 2020, "Covariance Matrix Adaptation for the
Rapid Illumination of Behavior Space" (CMA-ME, its improvement emitter); Fontaine and Nikolaidis 2021, "Differentiable
Quality Diversity" (CMA-MEGA). One thing differs from the papers: CMA-ES learns from the better half of a batch, even if
fewer of its changes added something.

They are built on the package `cmaes`; pyribs 0.12, which has both, also needs numba, scikit-learn and pandas.
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from regents_cosim.attacks.sampling.elite_grid import Change, EliteGrid, Gain, Proposal, ranks
from regents_cosim.attacks.sampling.evolution import cma_es

if TYPE_CHECKING:
    from cmaes import CMA

BATCH = 10  # changes per batch: CMA-ES's own choice for ten coordinates
_SPREAD = 0.5  # initial spread of CMA-ME, as of CMA-ES in `attacks.sampling.sampled_search`
_LENGTH = 1.0  # initial length of CMA-MEGA's steps: as far as random changes go

# Gives the gradients of the value and of each measure at a proposal, and adds the proposal to the grid.
Slopes = Callable[[Proposal], Float[np.ndarray, "row coordinate"]]


class RandomEmitter:
    """Changes of any start, from a normal distribution that never learns."""

    looks = 0  # roll-outs that proposing a batch takes

    def __init__(self, starts: int, size: int, seed: int) -> None:
        self._rng, self._starts, self._size = np.random.default_rng(seed), starts, size

    def ask(self) -> list[Proposal]:
        """Propose a batch of changes."""
        changes = self._rng.normal(size=(BATCH, self._size))
        return [Proposal(int(self._rng.integers(self._starts)), change) for change in changes]

    def tell(self, tried: Sequence[Proposal], gains: Sequence[Gain]) -> None:
        """Learn nothing."""


class CmaMe:
    """CMA-ES that ranks changes by what they add; where they add nothing, it restarts at an elite."""

    looks = 0

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
        self._cma = _evolution(mean, _SPREAD, self._rng)


class CmaMega:
    """Steps along the gradients of the value and of the measures, with weights that CMA-ES adapts."""

    looks = 1

    def __init__(self, grid: EliteGrid, size: int, measures: int, seed: int, slopes: Slopes) -> None:
        self._grid, self._rng, self._none = grid, np.random.default_rng(seed), Proposal(0, np.zeros(size))
        self._slopes, self._rows = slopes, 1 + measures
        self._begin()

    def ask(self) -> list[Proposal]:
        """Propose changes from the present one: always up the value, and to either side of each measure."""
        slopes = self._slopes(self._at)
        lengths = np.linalg.norm(slopes, axis=1, keepdims=True)
        unit = slopes / np.where(lengths > 0.0, lengths, 1.0)
        self._weights = np.stack([self._cma.ask() for _ in range(BATCH)])
        uphill = np.concatenate([np.abs(self._weights[:, :1]), self._weights[:, 1:]], axis=1)
        return [Proposal(self._at.start, change) for change in self._at.change + uphill @ unit]

    def tell(self, tried: Sequence[Proposal], gains: Sequence[Gain]) -> None:
        """Continue from the changes that added most, or from an elite if none did."""
        order = ranks(gains)
        self._cma.tell(list(zip(self._weights, order, strict=True)))
        if self._cma.should_stop() or not any(gain.adds for gain in gains):
            self._begin()
        else:
            self._at = self._at._replace(change=_mean_of_best(np.stack([one.change for one in tried]), order))

    def _begin(self) -> None:
        self._at = self._grid.draw(self._rng, self._none)
        self._cma = _evolution(np.zeros(self._rows), _LENGTH, self._rng)


Emitter = RandomEmitter | CmaMe | CmaMega


def _evolution(mean: Change, spread: float, rng: np.random.Generator) -> "CMA":
    return cma_es(mean, spread, BATCH, int(rng.integers(2**31)))


def _mean_of_best(changes: Float[np.ndarray, "change coordinate"], order: Sequence[float]) -> Change:
    """The mean of the better half, weighted as in CMA-ES (Hansen 2016, eq. 49 without its negative part)."""
    best = np.argsort(order)[: BATCH // 2]
    share = np.log((BATCH + 1) / 2) - np.log(np.arange(1, len(best) + 1))
    return (share / share.sum()) @ changes[best]
