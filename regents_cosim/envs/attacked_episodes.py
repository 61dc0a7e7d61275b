"""Chooses the episodes of an environment that are attacked."""

import numpy as np

from regents_cosim.errors import RegentsError, require


class AttackedEpisodes:
    """Chooses one of `every` episodes; the last seed of a reset draws the first one."""

    def __init__(self, every: int) -> None:
        """Raises RegentsError for less than one."""
        known = isinstance(every, int) and every >= 1
        require(known, f"every {every!r}, expected 1 (all episodes are attacked) or more", RegentsError)
        self._every, self._episode = every, -1

    def begin(self, seed: int | None) -> bool:
        """Begin another episode, and return whether it is attacked."""
        self._episode = self._episode + 1 if seed is None else int(np.random.default_rng(seed).integers(self._every))
        return self._episode % self._every == 0
