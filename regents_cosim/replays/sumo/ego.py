"""The bridge `sumo`: SUMO's own car-following and lane-changing models drive the ego.

A separate simulation runs beside the host's, in the planner's process. There SUMO drives the ego, all others are placed
where they are observed, and the ego's resulting pose is the answer. SUMO changes lanes in one step; here a lane change
takes 3 s, as with `--lanechange.duration 3` (with which moveToXY crashes, see `replay`).
"""

from collections.abc import Generator
from types import ModuleType

import numpy as np

from regents_cosim.errors import PlannerError, require
from regents_cosim.geometry.frames import Pose, SumoPose, ahead_and_left, from_sumo, to_sumo, wrap
from regents_cosim.maps.roadmap import Connection
from regents_cosim.planners.interface import Observation, Placement, Scene
from regents_cosim.replays.sumo.stage import EXACT
from regents_cosim.replays.sumo.vehicle_types import add_type
from regents_cosim.routes.to_target import way_to_target
from regents_cosim.simulators.sumo.bare_network import network_file
from regents_cosim.simulators.sumo.process import CRASHES_STAY, as_words, running_sumo
from regents_cosim.simulators.sumo.routes import edges_along

_EGO, _ROUTE = "ego", "way"
_ON_ROUTE = 1  # keepRoute of moveToXY: on the nearest lane of the route
_JUMP_M = 1.0  # sideways in one step: a larger jump is a lane change
_ACROSS_S = 3.0  # duration of a lane change
_CLEAR_M = 0.5  # an ego that is less off its lane does not occupy the next one
_STEEPEST = 0.35  # sideways per metre ahead, about 20 degrees: no vehicle slides sideways while standing

_Drive = Generator[Placement | None, Observation, None]


class SumoEgo:
    """Drives the ego as SUMO would, in cases that were recorded there."""

    def __init__(self, options: str) -> None:
        """`options` is the text after `sumo:`, and must be empty. Raises PlannerError."""
        require(not options, f"planner 'sumo:{options}' not found, expected `sumo`", PlannerError)
        self._drive: _Drive | None = None

    def reset(self, scene: Scene) -> None:
        """Restart SUMO. Raises PlannerError where the scene has no network of SUMO."""
        if self._drive is not None:
            self._drive.close()
        self._drive = _drive(scene)
        next(self._drive)

    def act(self, observation: Observation) -> Placement:
        """The placement of the ego by SUMO."""
        assert self._drive is not None
        placed = self._drive.send(observation)
        assert placed is not None
        return placed


def _drive(scene: Scene) -> _Drive:
    """A simulation as a function from an observation to the ego's next placement; closing it closes SUMO."""
    net = scene.road.sumo_net
    if net is None:
        raise PlannerError(f"planner 'sumo' needs a case recorded in SUMO, the map of {scene.id} has no SUMO network")
    options = {"step-length": repr(scene.dt), **CRASHES_STAY, "collision.action": "none"}  # those that crash drive on
    with network_file(net) as path, running_sumo(as_words({"net-file": str(path), **options})) as sumo:
        stage = _Simulation(sumo, scene)
        observation = yield None
        stage.begin(observation)
        while True:
            observation = yield stage.go(observation)


class _Simulation:
    """The running simulation."""

    def __init__(self, sumo: ModuleType, scene: Scene) -> None:
        self._sumo, self._scene = sumo, scene
        self._there: set[int] = set()  # indices of the others that are on the road
        ego = scene.ego
        way = way_to_target(scene.road, Pose(ego.x, ego.y, ego.yaw), ego.z, scene.target)
        sumo.route.add(_ROUTE, edges_along(scene.road, way))
        add_type(sumo, _EGO, ego)
        sumo.vehicletype.setSpeedDeviation(_EGO, 0.0)  # exactly the speed limit, without SUMO's random factor
        for index, agent in enumerate(scene.others):
            add_type(sumo, _name(index), agent)
        self._lights = {(link.source, link.target): link for link in scene.road.connections if link.signal is not None}
        self._shown: dict[Connection, str] = {}

    def begin(self, observation: Observation) -> None:
        """Place all agents at their observed states; the ego on its lane, from which it may be offset."""
        ego, vehicle = observation.ego, self._sumo.vehicle
        self._place_others(observation, 0.0)
        vehicle.add(_EGO, _ROUTE, _EGO)
        x, y, angle = to_sumo(Pose(ego.x, ego.y, ego.yaw), ego.length)
        vehicle.moveToXY(_EGO, "", -1, float(x), float(y), float(angle), _ON_ROUTE)
        self._step(observation)
        if _EGO not in vehicle.getIDList():
            raise PlannerError(f"SUMO finds no lane for the ego at x {ego.x:.1f}, y {ego.y:.1f}")
        vehicle.setPreviousSpeed(_EGO, ego.speed)
        self._on_lane = self._pose()
        self._beside = _LaneOffset(_sideways(self._on_lane, Pose(ego.x, ego.y, ego.yaw)))
        self._last = Placement(ego.x, ego.y, ego.yaw, ego.speed)

    def go(self, observation: Observation) -> Placement:
        """The ego's placement one step after the observation."""
        dt = self._scene.dt
        self._show_lights(observation)
        # The ego reacts to positions before the step, while SUMO places the others after it.
        self._place_others(observation, dt)
        self._mind_the_lane_left()
        self._step(observation)
        self._last = self._read(dt) if _EGO in self._sumo.vehicle.getIDList() else _straight_on(self._last, dt)
        return self._last

    def _read(self, dt: float) -> Placement:
        pose, speed = self._pose(), float(self._sumo.vehicle.getSpeed(_EGO))
        jump = _sideways(self._on_lane, pose)
        if abs(jump) > _JUMP_M:
            self._beside.begin(-jump)
        self._on_lane = pose
        offset, slope = self._beside.advance(speed, dt)
        x, y = pose.x - offset * np.sin(pose.yaw), pose.y + offset * np.cos(pose.yaw)
        return Placement(float(x), float(y), float(wrap(pose.yaw + np.arctan(slope))), speed)

    def _mind_the_lane_left(self) -> None:
        """Also follow the vehicle ahead on the lane that the ego is leaving, while the ego is partly on it.

        SUMO does this with `--lanechange.duration`; without it, the ego leaves the old lane at once.
        """
        vehicle, offset = self._sumo.vehicle, self._beside.offset
        if _EGO not in vehicle.getIDList():
            return
        ahead = vehicle.getLeftLeaders(_EGO) if offset > 0 else vehicle.getRightLeaders(_EGO)
        speed, least_gap = vehicle.getSpeed(_EGO), vehicle.getMinGap(_EGO)
        allowed = [
            vehicle.getFollowSpeed(_EGO, speed, gap, vehicle.getSpeed(name), vehicle.getDecel(name), name)
            for name, gap in ahead
            if abs(offset) > _CLEAR_M and gap > -least_gap  # else the others are alongside
        ]
        slowest = min(allowed, default=speed)
        vehicle.setSpeed(_EGO, slowest if slowest < speed else -1.0)  # -1: SUMO decides

    def _pose(self) -> Pose:
        x, y = self._sumo.vehicle.getPosition(_EGO)
        return from_sumo(SumoPose(x, y, self._sumo.vehicle.getAngle(_EGO)), self._scene.ego.length)

    def _place_others(self, observation: Observation, ahead_s: float) -> None:
        """Place all agents where they will be after `ahead_s` [s] at constant velocity."""
        others, vehicle = observation.others, self._sumo.vehicle
        for index in range(len(others.agents)):
            name = _name(index)
            if not others.valid[index]:
                if index in self._there:
                    vehicle.remove(name)
                    self._there.remove(index)
                continue
            if index not in self._there:
                vehicle.add(name, _ROUTE, name)
                vehicle.setSpeedMode(name, 0)
                vehicle.setLaneChangeMode(name, 0)
                self._there.add(index)
            other = others.state(index)
            travelled = other.speed * ahead_s
            centre = Pose(other.x + travelled * np.cos(other.yaw), other.y + travelled * np.sin(other.yaw), other.yaw)
            x, y, angle = to_sumo(centre, other.length)
            vehicle.moveToXY(name, "", -1, float(x), float(y), float(angle), EXACT)
            vehicle.setSpeed(name, other.speed)

    def _step(self, observation: Observation) -> None:
        self._sumo.simulationStep()
        there = set(self._sumo.vehicle.getIDList())
        for index in self._there:
            if _name(index) in there:  # SUMO resets the speed of vehicles that enter another lane
                self._sumo.vehicle.setPreviousSpeed(_name(index), float(observation.others.speed[index]))

    def _show_lights(self, observation: Observation) -> None:
        for light in observation.lights:
            link = self._lights[light.lane, light.to_lane]
            if self._shown.get(link) != light.shows:
                self._sumo.trafficlight.setLinkState(link.signal, link.link, light.shows)
                self._shown[link] = light.shows


class _LaneOffset:
    """The offset of the ego to the left of its SUMO lane [m], which decreases with time."""

    def __init__(self, offset: float) -> None:
        self.offset = 0.0
        self.begin(offset)

    def begin(self, further: float) -> None:
        """Increase the offset to the left by `further` m, after the lane has changed."""
        self.offset += further
        self._rate = abs(self.offset) / _ACROSS_S

    def advance(self, speed: float, dt: float) -> tuple[float, float]:
        """The offset [m, to the left] after one step, and its change per metre ahead."""
        ahead = max(speed * dt, 1e-6)
        nearer = min(self._rate * dt, _STEEPEST * ahead, abs(self.offset))
        change = -np.sign(self.offset) * nearer
        self.offset += change
        return self.offset, change / ahead


def _name(index: int) -> str:
    return f"other{index}"


def _sideways(before: Pose, after: Pose) -> float:
    """The distance of `after` to the left of the heading line of `before` [m]."""
    return float(ahead_and_left(np, after.x - before.x, after.y - before.y, before.yaw)[1])


def _straight_on(last: Placement, dt: float) -> Placement:
    """The next placement at constant velocity, for an ego that has left the network."""
    travelled = last.speed * dt
    return Placement(
        last.x + travelled * float(np.cos(last.yaw)), last.y + travelled * float(np.sin(last.yaw)), last.yaw, last.speed
    )
