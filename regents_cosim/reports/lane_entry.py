"""When the adversary enters the ego's lane: the moment from which people expect a driver to react."""

import numpy as np
import shapely

from regents_cosim.geometry.boxes import corners
from regents_cosim.scenario import Scenario
from regents_cosim.verdicts.law.drive import agent_drive

_INTO_M = 0.3  # UN R157, 5.2.5.2: an intrusion into a lane is 0.3 m beyond its marking


def enters_lane(scenario: Scenario) -> int | None:
    """The step at which the road user that the ego hits is 0.3 m inside the lanes of the ego.

    It then stays there until the two collide. None without a collision, where it is in these lanes all along or comes
    from behind in them, and where the ego drives along no lanes that the map knows.
    """
    hit = scenario.attack.collision if scenario.attack else None
    if hit is None or hit.collision_type == "rear_end_by_adversary":
        return None
    other = next(index for index, agent in enumerate(scenario.agents) if agent.id == hit.agent)
    lanes = {lane.id: lane for lane in agent_drive(scenario, 0, hit.step).front_lanes if lane is not None}
    inner = [lane.line.buffer(max(0.5 * lane.width - _INTO_M, 0.0), cap_style="flat") for lane in lanes.values()]
    its = agent_drive(scenario, other, hit.step)
    inside = np.asarray(shapely.intersects(shapely.union_all(inner), shapely.polygons(np.asarray(corners(its.box)))))
    outside = np.flatnonzero(~inside)
    if not len(outside) or outside[-1] == len(inside) - 1:
        return None
    return int(its.steps[outside[-1] + 1])
