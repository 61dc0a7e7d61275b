"""CMA-ME: proposes changes in a search for diverse crashes, and learns from what they add to a grid.

Source: Fontaine et al. 2020, "Covariance Matrix Adaptation for the Rapid Illumination of Behavior Space" (its
improvement emitter). One thing differs from the paper: CMA-ES learns from the better half of a batch, even if fewer of
its changes added something.

It is built on the package `cmaes`; pyribs 0.12, which has it, also needs numba, scikit-learn and pandas.
"""

from collections.abc import Sequence

import numpy as np

from regents_cosim.attacks.sampling.elite_grid import EliteGrid, Gain, Proposal, ranks
from regents_cosim.attacks.sampling.evolution import cma_es

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
