"""States that egos have reached beside their logs: lessons yet to be given."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int


@dataclass(frozen=True, eq=False)
class ReachedStates:
    """States by scene, agent and step."""

    rows: Int[np.ndarray, "lesson 3"]
    states: Float[np.ndarray, "lesson 4"]  # x, y [m], yaw [rad], speed [m/s]

    @classmethod
    def nothing(cls) -> "ReachedStates":
        """An empty set of states."""
        return cls(np.zeros((0, 3), int), np.zeros((0, 4)))

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, chosen: np.ndarray) -> "ReachedStates":
        return ReachedStates(self.rows[chosen], self.states[chosen])

    def __add__(self, more: "ReachedStates") -> "ReachedStates":
        return ReachedStates(np.concatenate([self.rows, more.rows]), np.concatenate([self.states, more.states]))

    def balanced(self, danger: Bool[np.ndarray, " lesson"], rng: np.random.Generator) -> "ReachedStates":
        """The states in `danger`, and equally many others."""
        others = rng.permutation(np.flatnonzero(~danger))[: int(danger.sum())]
        return self[np.concatenate([np.flatnonzero(danger), others])]

    def drawn_into(self, own: "ReachedStates", share: float, rng: np.random.Generator) -> "ReachedStates":
        """The lessons `own` with a `share` of them replaced by states of this set, if it has any."""
        if not len(self) or not share:
            return own
        those = rng.random(len(own)) < share
        drawn = self[rng.integers(len(self), size=len(own))]
        return ReachedStates(
            np.where(those[:, None], drawn.rows, own.rows), np.where(those[:, None], drawn.states, own.states)
        )
