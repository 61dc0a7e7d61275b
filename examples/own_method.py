"""A method of attack of your own: climb uphill from lawful drives, as an alternative to gradients and CMA-ES.

It takes the rules of `focused` (who may attack, which drives come first, which crashes count) and replaces what follows
those drives: a sampler that goes on from the best change so far.
"""

from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np

from regents_cosim import attack, network_config, record
from regents_cosim.attacks.methods.presets import ByRulesOfFocused, Tries
from regents_cosim.attacks.sampling.sampled_search import CHANGES, COORDINATES, Sampling

UPHILL = Tries(starts=12, attempts=3)  # none of which sample by CMA-ES


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
class HillClimbing(ByRulesOfFocused):
    """Its fields are settings: `HillClimbing(spread=1.0).but(iterations=300)`."""

    method: str = "hill-climbing"
    tries: Tries = UPHILL
    spread: float = 0.5

    descends: ClassVar[bool] = False

    def longer(self, candidate, start, samples):
        """What follows the looks at the drives."""
        job = candidate.job._replace(start=start)
        return Sampling(candidate.scenario.id, job, self, partial(Climb, self.spread), self.steps.iterations)


if __name__ == "__main__":
    windows = record(network_config("crossing"), count=4, seed=0)
    for case in attack(windows, HillClimbing().but(iterations=200, nearest=2), "idm"):
        print(f"{case.id}: {case.attack.outcome} after {case.attack.rollouts} roll-outs")
