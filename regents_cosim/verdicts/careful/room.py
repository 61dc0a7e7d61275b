"""The room that a careful driver keeps who avoids a crash."""

import numpy as np
from jaxtyping import Float

from regents_cosim.geometry.boxes import Boxes, distance
from regents_cosim.scenario import Agent, Scenario, Tracks


def room_m(scenario: Scenario) -> float | None:
    """The least distance [m] of the careful driver, once it acts, to what the ego hits; None where it is not known."""
    drive, since, tracks = scenario.evasion, scenario.evades_from, scenario.tracks
    met = scenario.index(scenario.collision.agent) if scenario.collision else scenario.adversary
    if drive is None or met is None:
        return None
    apart = gaps_m(scenario.agents, drive, tracks, met)
    least = np.where(tracks.valid[met], apart, np.inf)[since:].min()
    return float(least) if np.isfinite(least) else None


def gaps_m(agents: tuple[Agent, ...], ego: Tracks, others: Tracks, other: int) -> Float[np.ndarray, " step"]:
    """The distances [m] of the bodies of the ego, along its own tracks, and of one of the others, along theirs."""
    one, two = agents[0], agents[other]
    mine = Boxes(ego.x[0], ego.y[0], ego.yaw[0], one.length, one.width, ego.z[0])
    its = Boxes(others.x[other], others.y[other], others.yaw[other], two.length, two.width, others.z[other])
    return np.asarray(distance(mine, its))
