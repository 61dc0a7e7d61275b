"""highway-env as the host simulation of a live attack."""

import copy
from collections.abc import Callable, Collection
from typing import Any

import numpy as np
from highway_env.road.lane import AbstractLane
from highway_env.road.regulation import RegulatedRoad
from highway_env.road.road import LaneIndex, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.kinematics import Vehicle

from regents_cosim.geometry.frames import HighwayPose, Pose, from_highway, to_highway
from regents_cosim.live.host.interface import OFF_LANE_M, Frame
from regents_cosim.live.predict.paths import path_along
from regents_cosim.live.predict.traffic import Following, RoadUser, TrafficState
from regents_cosim.live.search.plan import Plan
from regents_cosim.maps.roadmap import Lane
from regents_cosim.routes.ego_route import lanes_ahead
from regents_cosim.scenario.scenario import Agent
from regents_cosim.simulators import COLOURS
from regents_cosim.simulators.highway.environments import sees_pictures
from regents_cosim.simulators.highway.net import lane_name, road_map_of
from regents_cosim.simulators.sumo.types import VehicleType

Spare = Collection[str] | Callable[[Any], bool]

_REACH_S = 3.0  # length of paths beyond the horizon
_MOST_REACH_M = 400.0
_EGO = "ego"


class HighwayHost:
    """The road of an environment of highway-env since its last reset; its first controlled vehicle is the ego."""

    speed_only = False

    def __init__(self, env: Any, radius_m: float, spare: Spare = ()) -> None:
        """`spare` is as in `LiveAdversary`."""
        self._env, self._radius_m, self._spare = env, radius_m, spare
        self.step_s = 1.0 / env.config["simulation_frequency"]
        self._named: dict[str, Vehicle] = {}
        self.road = road_map_of(env.road.network)

    def __deepcopy__(self, memo: dict[int, Any]) -> "HighwayHost":
        """Copy for a copy of the environment; the map is shared."""
        other = memo[id(self)] = copy.copy(self)
        other._env, other._named = copy.deepcopy((self._env, self._named), memo)
        return other

    def frame(self, time_s: float) -> Frame:
        """The state of all vehicles around the ego."""
        ego = self._env.vehicle
        x, y = ego.position
        near = [
            v for v in self._env.road.vehicles if v is not ego and np.hypot(*(v.position - (x, y))) < self._radius_m
        ]
        rows = {_EGO: ego} | {self._name(vehicle): vehicle for vehicle in near}
        places = np.array([(*v.position, v.heading) for v in rows.values()], float)
        x, y, yaw = (
            np.asarray(values) for values in from_highway(HighwayPose(places[:, 0], places[:, 1], places[:, 2]))
        )
        speed = np.array([max(float(v.speed), 0.0) for v in rows.values()])
        types = tuple(VehicleType("car", float(v.LENGTH), float(v.WIDTH)) for v in rows.values())
        return Frame(time_s, tuple(rows), x, y, yaw, speed, np.zeros(len(x)), types, {})

    def traffic(self, frame: Frame, most: int, horizon_s: float) -> TrafficState:
        """The ego and the nearest others, at most `most` in all, with their expected motion."""
        users = tuple(self._user(frame, row, horizon_s) for row in frame.nearest(most))
        return TrafficState(frame.time_s, users, self.road, {})

    def is_at_stop(self, name: str) -> bool:
        """False, since vehicles of highway-env do not make scheduled stops."""
        return False

    def is_spared(self, name: str) -> bool:
        """Whether a vehicle is one of the user's agents, or is otherwise to be spared."""
        vehicle = self._named[name]
        if any(vehicle is one for one in self._env.controlled_vehicles):
            return True
        if callable(self._spare):
            return bool(self._spare(vehicle))
        return name in self._spare or type(vehicle).__name__ in self._spare

    def take(self, name: str, length_m: float) -> "HighwayControl":
        """Take over a vehicle."""
        return HighwayControl(name, self._named[name], shown=not sees_pictures(self._env))

    def _name(self, vehicle: Vehicle) -> str:
        """The name of a vehicle, which never changes."""
        known = next((name for name, one in self._named.items() if one is vehicle), None)
        if known is None:
            known = f"vehicle{len(self._named):03d}"
            self._named[known] = vehicle
        return known

    def _user(self, frame: Frame, row: int, horizon_s: float) -> RoadUser:
        name, kind = frame.ids[row], frame.types[row]
        vehicle = self._env.vehicle if row == 0 else self._named[name]
        x, y, yaw, speed = (float(values[row]) for values in (frame.x, frame.y, frame.yaw, frame.speed))
        ahead = 0.5 * kind.length
        front = x + ahead * np.cos(yaw), y + ahead * np.sin(yaw)
        lanes, along_m = self._lanes(vehicle)
        reach_m = 20.0 + 1.2 * max(speed, 5.0) * (horizon_s + _REACH_S)
        path = path_along(lanes, along_m + ahead, front, yaw, speed, min(reach_m, _MOST_REACH_M))
        agent = Agent(name, "car", kind.length, kind.width, "ego" if row == 0 else "background")
        return RoadUser(agent, x, y, yaw, speed, path, _following(vehicle))

    def _lanes(self, vehicle: Any) -> tuple[list[Lane], float]:
        """The lanes ahead, beginning with the vehicle's target lane, and the distance of its centre along that lane
        [m].
        """
        network: RoadNetwork = self._env.road.network
        begin, end, number = getattr(vehicle, "target_lane_index", None) or vehicle.lane_index
        index: LaneIndex = (begin, end, int(number))  # highway-env makes the number a NumPy one by clipping
        along, _ = network.get_lane(index).local_coordinates(vehicle.position)
        names = [lane_name(index)]
        for begin, end, number in getattr(vehicle, "route", None) or ():
            if begin == index[1]:
                number = index[2] if number is None else int(number)
                index = (begin, end, min(number, len(network.graph[begin][end]) - 1))
                names.append(lane_name(index))
        lanes = [self.road.lane[name] for name in names]
        return [*lanes, *lanes_ahead(self.road, lanes[-1], _MOST_REACH_M)[1:]], max(float(along), 0.0)


class HighwayControl:
    """Control over one vehicle of highway-env: it goes where it is placed, and decides nothing itself."""

    def __init__(self, name: str, vehicle: Any, shown: bool = True) -> None:
        """Where `shown`, the vehicle has the colour of an adversary, which an agent with a camera would learn."""
        self.name, self._vehicle, self._shown = name, vehicle, shown
        own = {name: value for name, value in vehicle.__dict__.items() if name == "color"}
        self._colour = {} if _is_yielding(vehicle) else own
        self._paint()
        vehicle.act, vehicle.step = self._decide_nothing, self._go
        self._next: tuple[float, float, float, float] | None = None

    def follow_route_of(self, plan: Plan) -> None:
        """Do nothing: other vehicles of highway-env react to positions, not to routes."""

    def confirm(self) -> None:
        """Do nothing: the vehicle is where it was placed."""

    def place(self, x: float, y: float, yaw: float, speed: float) -> None:
        """Set the centre [m], the yaw [rad] and the speed [m/s] after the next step."""
        self._next = x, y, yaw, max(speed, 0.0)
        self._paint()  # an intersection recolours vehicles that wait there

    def _paint(self) -> None:
        if self._shown:
            self._vehicle.color = COLOURS["adversary"]

    def is_at_ease(self) -> bool:
        """Whether it is near the middle of its lane; highway-env's drivers have no comfortable braking to respect."""
        lane: AbstractLane = self._vehicle.lane
        return abs(float(lane.local_coordinates(self._vehicle.position)[1])) < OFF_LANE_M

    def give_back(self) -> bool:
        """Let the vehicle decide again, on its current lane; False where it has gone."""
        vehicle = self._vehicle
        del vehicle.act, vehicle.step
        vehicle.__dict__.pop("color", None)
        # A waiting vehicle needs a colour, since the intersection deletes it when the wait is over.
        vehicle.__dict__.update({"color": RegulatedRoad.YIELDING_COLOR} if _is_yielding(vehicle) else self._colour)
        vehicle.target_lane_index = vehicle.lane_index
        return vehicle in vehicle.road.vehicles

    def _decide_nothing(self, action: Any = None) -> None:
        return None

    def _go(self, dt: float) -> None:
        """Move the vehicle by one step of the road."""
        vehicle = self._vehicle
        if self._next is not None:
            x, y, yaw, speed = self._next
            pose = to_highway(Pose(x, y, yaw))
            vehicle.position = np.array([pose.x, pose.y], float)
            vehicle.heading, vehicle.speed = float(pose.heading), speed
        vehicle.impact = None
        vehicle.on_state_update()


def _is_yielding(vehicle: Any) -> bool:
    """Whether an intersection of highway-env makes it wait, and colours it."""
    return bool(getattr(vehicle, "is_yielding", False))


def _following(vehicle: Any) -> Following:
    """The car-following parameters of a vehicle with a driver of highway-env."""
    wanted = max(float(getattr(vehicle, "target_speed", vehicle.speed)), 1.0)
    kind = type(vehicle) if isinstance(vehicle, IDMVehicle) else IDMVehicle
    return Following(
        accel=kind.COMFORT_ACC_MAX,
        decel=-kind.COMFORT_ACC_MIN,
        tau_s=kind.TIME_WANTED,
        min_gap_m=kind.DISTANCE_WANTED - kind.LENGTH,
        max_speed_m_s=wanted,
        model="idm",
    )
