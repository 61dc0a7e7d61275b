"""Which crashes tell something about the planner: clean success, and what spoils it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from regents_cosim.boxes import Boxes, corners, overlap
from regents_cosim.levels import beyond_road
from regents_cosim.limits import OFF_ROAD_M, STANDING_M_S
from regents_cosim.roadmap import RoadMap
from regents_cosim.scenario import Scenario


@dataclass(frozen=True)
class Cleanness:
    """Flaws of one crash; clean where it has none."""

    attributed: bool  # the ego met an agent whose controls the attack changed
    off_road: bool  # the adversary left the road before the crash
    hits_others: bool  # the adversary touched somebody else before the crash
    rear_ends_ego: bool  # the adversary ran into the back of the ego
    ego_stands: bool

    @property
    def clean(self) -> bool:
        """None of the flaws."""
        return self.attributed and not (self.off_road or self.hits_others or self.rear_ends_ego or self.ego_stands)


def cleanness(attacked: Scenario) -> Cleanness | None:
    """What is wrong with the crash of an attacked scenario; None where there is none."""
    hit = attacked.attack.collision if attacked.attack and attacked.attack.outcome == "collision" else None
    if hit is None:
        return None
    agent = next(i for i, a in enumerate(attacked.agents) if a.id == hit.agent)
    return Cleanness(
        attributed=hit.attributed,
        off_road=_leaves_road(attacked, agent, hit.step),
        hits_others=_touches_others(attacked, agent, hit.step),
        rear_ends_ego=hit.kind == "rear_end_by_adversary",
        ego_stands=bool(attacked.tracks.speed[0, hit.step] < STANDING_M_S),
    )


def corners_off_road(road: RoadMap, box: Boxes) -> Bool[np.ndarray, "*axes 4"]:
    """Which corners of boxes are more than 0.3 m off the road."""
    return beyond_road(road, corners(box), np.asarray(box.z)[..., None]) > OFF_ROAD_M


def _leaves_road(attacked: Scenario, agent: int, step: int) -> bool:
    """Whether a corner that began on the road is more than 0.3 m off it up to `step`."""
    steps = np.flatnonzero(attacked.tracks.valid[agent, : step + 1])
    box = Boxes(*(np.broadcast_to(values, attacked.tracks.x.shape)[agent, steps] for values in attacked.boxes))
    off = corners_off_road(attacked.road, box)
    return bool(off[:, ~off[0]].any())


def _touches_others(attacked: Scenario, agent: int, step: int) -> bool:
    """Whether the adversary overlaps somebody up to `step` whom it did not overlap in the recording."""
    tracks = attacked.tracks
    boxes = [np.broadcast_to(values, tracks.x.shape)[:, : step + 1] for values in attacked.boxes]
    there = tracks.valid[:, : step + 1] & tracks.valid[agent, : step + 1]
    hits = np.any(there & overlap(Boxes(*(values[agent] for values in boxes)), Boxes(*boxes)), axis=1)
    name = attacked.agents[agent].id
    known = {other for pair in attacked.overlaps if name in pair.agents for other in pair.agents}
    touched = set(np.flatnonzero(hits)) - {0, agent}
    return any(attacked.agents[other].id not in known for other in touched)
