"""The room that a careful driver keeps who avoids a crash."""

import numpy as np
from jaxtyping import Float

from regents_cosim.geometry.boxes import distance
from regents_cosim.scenario import Agent, Scenario, Tracks, boxes_of


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
    return np.asarray(distance(boxes_of(agents[:1], ego).at(0), boxes_of(agents, others).at(other)))
