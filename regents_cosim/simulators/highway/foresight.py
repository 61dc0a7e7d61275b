"""A copy of an environment in which a planner may try actions: nothing in it tells what the others will do.

In the copy of a replay, those within 80 m drive by themselves, and no others are there. A vehicle keeps its speed and
brakes for the one ahead in its lane (highway-env's IDM without lane changes). Those who walk or are off the lanes go
straight on.
"""

import copy
from typing import Any

import numpy as np
from highway_env.envs.common.abstract import AbstractEnv
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.kinematics import Vehicle

from regents_cosim.geometry.frames import wrap
from regents_cosim.simulators.highway.cast import ReplayRoad, ScriptedVehicle

_ALONG_LANE_RAD = 0.5
_SEEN_M = 80.0
_SHORTEST_M = 2.5  # of who keeps to a lane: pedestrians and bicycles are shorter


def foreseen(env: AbstractEnv) -> AbstractEnv:
    """A copy of `env` as it is now, for `step`."""
    road: Any = env.road
    if not isinstance(env.road, ReplayRoad):
        return copy.deepcopy(env)
    own, ego = ReplayRoad(road.network, copy.deepcopy(road.np_random)), road.vehicles[0]
    own.moment = road.moment
    shared = (env.config.get("case"), getattr(env, "scenario", None))
    memo: dict[int, Any] = {id(road): own} | {id(one): one for one in shared if one is not None}
    result = copy.deepcopy(env, memo)
    near = [other for other in road.vehicles[1:] if np.hypot(*(other.position - ego.position)) < _SEEN_M]
    own.enter(result.vehicle, [_free(other, own) for other in near])
    return result


def _free(scripted: Any, road: ReplayRoad) -> Vehicle:
    """A vehicle at the same place that drives on by itself."""
    state = scripted.position.copy(), float(scripted.heading), float(scripted.speed)
    kind = _KeepsLane if _is_on_lane(scripted) else _GoesStraight
    free: Any = kind(road, *state)
    free.LENGTH, free.WIDTH, free.diagonal = scripted.LENGTH, scripted.WIDTH, scripted.diagonal
    free.name, free.color = scripted.name, scripted.color
    return free


def _is_on_lane(scripted: ScriptedVehicle) -> bool:
    lane = scripted.lane
    if lane is None or scripted.LENGTH < _SHORTEST_M:
        return False
    along, left = lane.local_coordinates(scripted.position)
    turned = abs(float(wrap(np.asarray(scripted.heading - lane.heading_at(along)))))
    return abs(left) < 0.5 * lane.width_at(along) and turned < _ALONG_LANE_RAD


class _GoesStraight(Vehicle):
    name, present = "", True

    def on_state_update(self) -> None:
        """Do nothing: it needs no lane, and to find the closest one costs more than all else."""


class _KeepsLane(IDMVehicle):
    name, present = "", True

    def __init__(self, road: ReplayRoad, position: np.ndarray, heading: float, speed: float) -> None:
        super().__init__(road, position, heading, speed, enable_lane_change=False)

    def on_state_update(self) -> None:
        """Look for a lane where it has left its own."""
        lane: Any = self.lane
        if lane is None or not lane.on_lane(self.position):
            super().on_state_update()
