"""A method of attack of your own: climb uphill from drives on lawful paths, as an alternative to gradients and CMA-ES.

It takes the rules of `focused` (who may attack, which drives come first, which crashes count) and what follows those
drives from a sampler of its own, which goes on from the best change so far.
"""

from dataclasses import dataclass

import numpy as np

from regents_cosim import attack, network_config, record
from regents_cosim.attacks.methods.presets import BySampling
from regents_cosim.attacks.sampling.sampled_search import CHANGES, COORDINATES


class Climb:
    """Proposes changes near the best one."""

    def __init__(self, spread, seed):
        self.spread, self.rng = spread, np.random.default_rng(seed)
        self.best, self.least = np.zeros(COORDINATES), np.inf

    def ask(self):
        """Propose changes."""
        return self.best + self.spread * self.rng.normal(size=(CHANGES, COORDINATES))

    def tell(self, changes, costs):
        """Keep the best change."""
        if costs.min() < self.least:
            self.best, self.least = changes[costs.argmin()], costs.min()


@dataclass(frozen=True, repr=False)
class HillClimbing(BySampling):
    """Its fields are settings, in Python `HillClimbing(spread=1.0).but(iterations=300)`.

    Those with words below them stand in the file of `regents config attack --method own_method.py:HillClimbing`.
    """

    method: str = "hill-climbing"
    spread: float = 0.5
    """standard deviation of a change [share of the limit of an action]"""

    def sampler(self, seed):
        """What proposes changes of a drive."""
        return Climb(self.spread, seed)


if __name__ == "__main__":
    windows = record(network_config("crossing"), count=4, seed=0)
    for case in attack(windows, HillClimbing().but(iterations=200, nearest=2), "idm"):
        print(f"{case.id}: {case.attack.outcome} after {case.attack.rollouts} roll-outs")
