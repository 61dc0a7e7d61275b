"""Who proposes changes to a search for diverse crashes: at random, by CMA-ME, or by CMA-MEGA.

They go by what their changes add to a grid. Sources: Fontaine et al. 2020, "Covariance Matrix Adaptation for the Rapid
Illumination of Behavior Space" (CMA-ME, its improvement emitter); Fontaine and Nikolaidis 2021, "Differentiable Quality
Diversity" (CMA-MEGA). In one thing they differ from the papers: CMA-ES learns from the better half of a batch, also
where fewer of its changes added something.

Written on the package `cmaes`: pyribs 0.12, which has both, needs numba, scikit-learn and pandas besides.
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from regents_cosim.attacks.diverse.elite_grid import Change, EliteGrid, Gain, Proposal, ranks
from regents_cosim.attacks.evolution import cma_es

if TYPE_CHECKING:
    from cmaes import CMA

BATCH = 10  # changes between two answers, CMA-ES's own choice for ten coordinates
_SPREAD = 0.5  # of CMA-ME at first, as CMA-ES has it in `attacks.sampled_search`
_LENGTH = 1.0  # of CMA-MEGA's steps along a gradient at first: as far as the changes at random go

# The gradients of the value and of each measure; what a look at the proposal shows is added to the grid.
Slopes = Callable[[Proposal], Float[np.ndarray, "row coordinate"]]


class RandomEmitter:
    """Changes of any start from a normal distribution that never learns."""

    looks = 0  # roll-outs that it takes to propose a batch

    def __init__(self, starts: int, size: int, seed: int) -> None:
        self._rng, self._starts, self._size = np.random.default_rng(seed), starts, size

    def ask(self) -> list[Proposal]:
        """A batch to try."""
        changes = self._rng.normal(size=(BATCH, self._size))
        return [Proposal(int(self._rng.integers(self._starts)), change) for change in changes]

    def tell(self, tried: Sequence[Proposal], gains: Sequence[Gain]) -> None:
        """Nothing is learnt."""


class CmaMe:
    """CMA-ES that ranks by what is added; where nothing is, it begins again at an elite."""

    looks = 0

    def __init__(self, grid: EliteGrid, size: int, seed: int) -> None:
        self._grid, self._rng, self._none = grid, np.random.default_rng(seed), Proposal(0, np.zeros(size))
        self._begin()

    def ask(self) -> list[Proposal]:
        """A generation."""
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
    """Steps along the gradients of the value and of the measures, by weights that CMA-ES adapts."""

    looks = 1

    def __init__(self, grid: EliteGrid, size: int, measures: int, seed: int, slopes: Slopes) -> None:
        self._grid, self._rng, self._none = grid, np.random.default_rng(seed), Proposal(0, np.zeros(size))
        self._slopes, self._rows = slopes, 1 + measures
        self._begin()

    def ask(self) -> list[Proposal]:
        """Branches from where it is: always up the value, and to either side of each measure."""
        slopes = self._slopes(self._at)
        lengths = np.linalg.norm(slopes, axis=1, keepdims=True)
        unit = slopes / np.where(lengths > 0.0, lengths, 1.0)
        self._weights = np.stack([self._cma.ask() for _ in range(BATCH)])
        uphill = np.concatenate([np.abs(self._weights[:, :1]), self._weights[:, 1:]], axis=1)
        return [Proposal(self._at.start, change) for change in self._at.change + uphill @ unit]

    def tell(self, tried: Sequence[Proposal], gains: Sequence[Gain]) -> None:
        """Go on from the branches that added most; where none did, from an elite."""
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
    """Of the better half, weighed as CMA-ES weighs its own (Hansen 2016, eq. 49 without its negative part)."""
    best = np.argsort(order)[: BATCH // 2]
    share = np.log((BATCH + 1) / 2) - np.log(np.arange(1, len(best) + 1))
    return (share / share.sum()) @ changes[best]
