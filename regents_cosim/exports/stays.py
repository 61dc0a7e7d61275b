"""When each agent is there, and on which lanes: what every format asks of a Scenario."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.routes.lane_matching import match_lanes
from regents_cosim.scenario import Agent, Scenario


@dataclass(frozen=True)
class Stay:
    """An agent from the step at which it appears until it leaves; some come back."""

    agent: Agent
    index: int  # of the agent in its Scenario
    first: int
    last: int

    @property
    def steps(self) -> slice:
        """To cut an array over time with."""
        return slice(self.first, self.last + 1)


def stays(scenario: Scenario) -> Iterator[Stay]:
    """Every stay, agent by agent and in the order of time."""
    for index, agent in enumerate(scenario.agents):
        here = np.flatnonzero(np.diff(scenario.tracks.valid[index], prepend=False, append=False))
        yield from (Stay(agent, index, int(a), int(b) - 1) for a, b in here.reshape(-1, 2))


def poses(scenario: Scenario, stay: Stay) -> Float[np.ndarray, "time 4"]:
    """Box centre x, y [m], yaw [rad] and speed [m/s] along a stay."""
    tracks = scenario.tracks
    return np.stack(
        [values[stay.index, stay.steps] for values in (tracks.x, tracks.y, tracks.yaw, tracks.speed)], axis=-1
    )


def lanes_along(scenario: Scenario, points: Float[np.ndarray, "time 2"], z: Float[np.ndarray, " time"]) -> list[str]:
    """The lane under each point [m] of a way at heights `z` [m]; where there is none, that of the last point with one.

    Ways that never meet a lane that runs along them count as on the lane nearest to each point. Empty names on a map
    without lanes.
    """
    road = scenario.road
    if not road.lanes:
        return [""] * len(points)
    found = [lane.id if lane else "" for lane in match_lanes(road, points, z)] if len(points) > 1 else [""]
    if not any(found):
        near = road.centre_lines.query_nearest(shapely.points(points), all_matches=False)[1]
        return [road.lanes[i].id for i in near]
    held = next(filter(None, found))
    filled = []
    for name in found:
        held = name or held
        filled.append(held)
    return filled
