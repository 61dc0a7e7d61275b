"""A copy of an environment in which a planner may try actions: nothing in it tells what the others will do.

In the copy of a replay, those within 80 m drive by themselves, and no others are there. A vehicle keeps its speed and
brakes for the one ahead in its lane (highway-env's IDM without lane changes). Those who walk or are off the lanes go
straight on.
"""

import copy
from functools import lru_cache
from typing import Any, Self

import numpy as np
from highway_env.envs.common.abstract import AbstractEnv
from highway_env.road.road import LaneIndex
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.kinematics import Vehicle

from regents_cosim.geometry.frames import wrap
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.simulators.highway.cast import ReplayRoad, ScriptedVehicle
from regents_cosim.simulators.highway.road import beside_lane

_ALONG_LANE_RAD = 0.5
_SEEN_M = 80.0
_SHORTEST_M = 2.5  # of who keeps to a lane: pedestrians and bicycles are shorter


def foreseen(env: AbstractEnv) -> AbstractEnv:
    """A copy of `env` as it is now, for `step`."""
    replay: Any = env
    road: Any = env.road
    if not isinstance(env.road, ReplayRoad):
        return copy.deepcopy(env)
    own, ego = _OwnRoad(road.network, copy.deepcopy(road.np_random)), road.vehicles[0]
    own.moment = road.moment
    result = copy.deepcopy(replay, {id(road): own, id(replay.scenario): _ego_alone(replay.scenario)})
    near = [other for other in road.vehicles[1:] if np.hypot(*(other.position - ego.position)) < _SEEN_M]
    own.enter(result.vehicle, [_free(other, own) for other in near])
    return result


@lru_cache(maxsize=4)
def _ego_alone(scenario: Scenario) -> Scenario:
    """The case without the others, whose tracks tell what they will do, and without its attack."""
    return scenario.before_attack().keeping(np.arange(len(scenario.agents)) == 0)


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


class _OwnRoad(ReplayRoad):
    """Finds neighbours among all at once. highway-env takes them one by one, and a search spends its time there."""

    def neighbour_vehicles(
        self, vehicle: Vehicle, lane_index: LaneIndex | None = None
    ) -> tuple[Vehicle | None, Vehicle | None]:
        """The next ahead of `vehicle` and behind it, of those in the lane or up to 1 m beside it."""
        index, others = lane_index or vehicle.lane_index, [other for other in self.vehicles if other is not vehicle]
        if not index or not others:
            return None, None
        lane: Any = self.network.get_lane(index)
        here, _ = lane.local_coordinates(vehicle.position)
        along, off = beside_lane(lane, np.array([other.position for other in others]))
        within = (along >= -lane.VEHICLE_LENGTH) & (along < lane.length + lane.VEHICLE_LENGTH)
        within &= np.abs(off) <= 0.5 * lane.width + 1.0
        gap = np.where(within, along - here, np.nan)
        ahead, behind = np.where(gap >= 0.0, gap, np.inf), np.where(gap < 0.0, gap, -np.inf)
        front, rear = int(ahead.argmin()), int(behind.argmax())
        return others[front] if gap[front] >= 0.0 else None, others[rear] if gap[rear] < 0.0 else None


class _Copied:
    """A vehicle that drives by itself, copied without what never changes."""

    name, present = "", True

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        memo[id(self)] = result = copy.copy(self)
        for name in ("road", "position", "impact", "action", "log", "history"):
            setattr(result, name, copy.deepcopy(getattr(self, name), memo))
        return result


class _GoesStraight(_Copied, Vehicle):
    def on_state_update(self) -> None:
        """Do nothing: it needs no lane, and to find the closest one costs more than all else."""


class _KeepsLane(_Copied, IDMVehicle):
    def __init__(self, road: ReplayRoad, position: np.ndarray, heading: float, speed: float) -> None:
        super().__init__(road, position, heading, speed, enable_lane_change=False)

    def on_state_update(self) -> None:
        """Look for a lane where it has left its own."""
        lane: Any = self.lane
        if lane is None or not lane.on_lane(self.position):
            super().on_state_update()
