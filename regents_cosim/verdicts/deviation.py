"""Measure how far an attack moved its adversary from its log."""

from dataclasses import dataclass

import numpy as np

from regents_cosim.scenario import Scenario


@dataclass(frozen=True)
class Deviation:
    """Distance to the log over the steps up to the collision."""

    mean_m: float
    max_m: float


def deviation(attacked: Scenario) -> Deviation | None:
    """The deviation of the agent that the ego collides with; None where the attack found no collision."""
    hit = attacked.attack.collision if attacked.attack and attacked.attack.outcome == "collision" else None
    if hit is None or attacked.log is None:
        return None
    agent = next(i for i, a in enumerate(attacked.agents) if a.id == hit.agent)
    now, log, until = attacked.tracks, attacked.log, np.s_[agent, : hit.step + 1]
    apart = np.hypot(now.x[until] - log.x[until], now.y[until] - log.y[until])[now.valid[until] & log.valid[until]]
    return Deviation(float(apart.mean()), float(apart.max()))
