"""States that egos have got into, beside those of their logs: lessons yet to be given.

Steps at which a teacher brakes for who will be in its way are rare, on logs and in practice. Those that were met are
told apart, so that they can have a share of the lessons of their own.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int


@dataclass(frozen=True, eq=False)
class Met:
    """States by scene, agent and step."""

    rows: Int[np.ndarray, "lesson 3"]
    states: Float[np.ndarray, "lesson 4"]  # x, y [m], yaw [rad], speed [m/s]
    danger: Bool[np.ndarray, " lesson"]  # the teacher brakes for who will be in its way

    @classmethod
    def nothing(cls) -> "Met":
        """None yet."""
        return cls(np.zeros((0, 3), int), np.zeros((0, 4)), np.zeros(0, bool))

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, chosen: np.ndarray) -> "Met":
        return Met(self.rows[chosen], self.states[chosen], self.danger[chosen])

    def __add__(self, more: "Met") -> "Met":
        return Met(
            np.concatenate([self.rows, more.rows]),
            np.concatenate([self.states, more.states]),
            np.concatenate([self.danger, more.danger]),
        )

    def balanced(self, rng: np.random.Generator) -> "Met":
        """Those in danger, and as many of the others."""
        others = np.flatnonzero(~self.danger)
        kept = rng.permutation(others)[: int(self.danger.sum())]
        return self[np.concatenate([np.flatnonzero(self.danger), kept])]
