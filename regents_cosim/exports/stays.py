"""The times at which each agent is present, and its lanes, for all export formats."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.routes.lane_matching import match_lanes
from regents_cosim.scenario.scenario import Agent, Scenario


@dataclass(frozen=True)
class Presence:
    """One stay of an agent, from the step at which it appears until it leaves; some agents come back."""

    agent: Agent
    index: int  # of the agent in its Scenario
    first: int
    last: int

    @property
    def steps(self) -> slice:
        """A slice that selects the stay from an array over time."""
        return slice(self.first, self.last + 1)


def stays(scenario: Scenario) -> Iterator[Presence]:
    """Every stay, agent by agent, in the order of time."""
    for index, agent in enumerate(scenario.agents):
        here = np.flatnonzero(np.diff(scenario.tracks.valid[index], prepend=False, append=False))
        yield from (Presence(agent, index, int(a), int(b) - 1) for a, b in here.reshape(-1, 2))


def poses(scenario: Scenario, stay: Presence) -> Float[np.ndarray, "time 4"]:
    """Box centre x, y [m], yaw [rad] and speed [m/s] along a stay."""
    tracks = scenario.tracks
    return np.stack(
        [values[stay.index, stay.steps] for values in (tracks.x, tracks.y, tracks.yaw, tracks.speed)], axis=-1
    )


def lanes_along(scenario: Scenario, points: Float[np.ndarray, "time 2"], z: Float[np.ndarray, " time"]) -> list[str]:
    """The lane under each point [m] of a path at heights `z` [m]; points without a lane get that of the previous point.

    A path that never meets a lane in its direction gets the lane nearest to each point. The names are empty on a map
    without lanes.
    """
    road = scenario.road
    if not road.lanes:
        return [""] * len(points)
    found = [lane.id if lane else "" for lane in match_lanes(road, points, z)]
    if not any(found):
        near = road.centre_lines.query_nearest(shapely.points(points), all_matches=False)[1]
        return [road.lanes[i].id for i in near]
    held = next(filter(None, found))
    filled = []
    for name in found:
        held = name or held
        filled.append(held)
    return filled
