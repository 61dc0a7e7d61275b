"""Reads a running SUMO simulation through TraCI or libsumo, without changing it.

Every step: the vehicles around the ego (`Frame`). Before a plan: also their routes and car-following parameters
(`TrafficState`). With libsumo calls are cheap. With TraCI each is a message, so the surroundings of the ego's lane are
subscribed to. A subscription to those of the ego would add to what the user's own one tells, and end with it.
"""

from functools import lru_cache
from pathlib import Path as File
from typing import Any

import numpy as np
from traci import constants as tc

from regents_cosim.errors import SumoError
from regents_cosim.geometry.frames import Pose, SumoPose, from_sumo, to_sumo
from regents_cosim.live.host.interface import Frame
from regents_cosim.live.host.sumo_routes import REACH_S, GivenRoute, KnownRoute, SumoRoutes
from regents_cosim.live.host.vehicle_route import raise_unless_refused
from regents_cosim.live.predict.traffic import Following, RoadUser, Shows, TrafficState
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.scenario.scenario import Agent
from regents_cosim.simulators.sumo.closing import is_libsumo
from regents_cosim.simulators.sumo.net import read_road_map
from regents_cosim.simulators.sumo.options import MESOSCOPIC, is_on, path_of
from regents_cosim.simulators.sumo.types import VehicleType, is_articulated, kind_of

# Predicts the traffic lights of a running simulation from their programmes in SUMO.
#
# A phase without a fixed length, as in actuated lights, is assumed to last.
_STATIC = 0  # SUMO's number for programmes with fixed phases
_PHASES_AHEAD = 20  # most phases ahead

_Phase = tuple[float, str, bool, int]  # seconds, letters, whether the length is certain, and index of the next phase


class LightProgrammes:
    """The programmes of one simulation. `connection` is libsumo, traci, or a connection of traci."""

    def __init__(self, connection: Any) -> None:
        self._sumo = connection
        self._step_s = float(connection.simulation.getDeltaT())  # SUMO switches in the step that begins then

    def ahead(self, light: str, letters: str, now_s: float, seconds: float) -> Shows:
        """The letters that a light, which shows `letters` now, will show for some seconds."""
        lights = self._sumo.trafficlight
        phases, number = self._phases(light, lights.getProgram(light)), int(lights.getPhase(light))
        shows = [(0.0, letters)]
        if number >= len(phases) or phases[number][1] != letters:
            return tuple(shows)  # the user's code has set the letters
        at_s = float(lights.getNextSwitch(light)) - now_s + self._step_s
        while phases[number][2] and 0.0 < at_s < seconds and len(shows) < _PHASES_AHEAD:
            number = phases[number][3]
            shows.append((at_s, phases[number][1]))
            at_s += phases[number][0]
        return tuple(shows)

    def _phases(self, light: str, programme: str) -> list[_Phase]:
        """The phases of a programme as they are now, since the user's code may replace them under the same name."""
        logics = self._sumo.trafficlight.getAllProgramLogics(light)
        logic = next((one for one in logics if one.programID == programme), None)
        return [] if logic is None else _phases_of(logic)


def _phases_of(logic: Any) -> list[_Phase]:
    found = []
    for index, phase in enumerate(logic.phases):
        fixed = logic.type == _STATIC or phase.minDur == phase.maxDur == phase.duration
        following = phase.next[0] if phase.next else (index + 1) % len(logic.phases)
        found.append((float(phase.duration), str(phase.state), fixed and len(phase.next) < 2, int(following)))
    return found


_WANTED = {tc.VAR_POSITION3D, tc.VAR_ANGLE, tc.VAR_SPEED, tc.VAR_LANE_ID}
_NOWHERE_M = 1e8


@lru_cache(maxsize=4)
def _road(net: File, written_ns: int) -> RoadMap:
    """The map of a network file in its version `written_ns`; successive runs share it."""
    return read_road_map(net)


class SimulationReader:
    """Reads one simulation. `connection` is libsumo, traci, or a connection of traci."""

    def __init__(self, connection: Any, radius_m: float, route: GivenRoute | None = None) -> None:
        """`route` is the line that the ego drives along, if it is not SUMO's route.

        Raises SumoError for a simulation in which no vehicle can be followed, InputError for its network, RegentsError
        for an invalid route.
        """
        self._sumo, self._radius_m = connection, radius_m
        self._in_process = is_libsumo(connection)
        if is_on(self.option("mesosim")):
            raise SumoError(MESOSCOPIC)
        self.net = path_of(self.option("net-file"))
        self.road = _road(self.net, self.net.stat().st_mtime_ns if self.net.exists() else 0)
        self.step_s = float(connection.simulation.getDeltaT())
        # With lane changes that take time, a vehicle that is placed off its lane crashes SUMO 1.28.
        self.speed_only = float(self.option("lateral-resolution") or 0) > 0 or (
            float(self.option("lanechange.duration") or 0) > 0
        )
        self._route = route
        self._known_route = None if route is None or callable(route) else KnownRoute(route, self.road)
        self.routes, self._programmes = SumoRoutes(connection, self.road), LightProgrammes(connection)
        self._types: dict[str, VehicleType] = {}
        self._following: dict[str, Following] = {}
        self._subscribed = ""  # the lane whose surroundings are subscribed to
        places: dict[str, list[np.ndarray]] = {}
        for link in self.road.connections:
            if link.signal is not None:
                places.setdefault(link.signal, []).append(self.road.lane[link.source].centre[-1])
        self._lights = {name: np.mean(points, axis=0) for name, points in places.items()}

    def option(self, name: str) -> str:
        """The value of an option of the simulation; empty where SUMO does not know the option."""
        try:
            return str(self._sumo.simulation.getOption(name))
        except Exception:  # an older SUMO, or none; TraCI's errors have no common class
            return ""

    # --- every step ------------------------------------------------------------------------------

    def frame(self, ego: str, time_s: float) -> Frame | None:
        """All vehicles around the ego; None where the ego is not on the road."""
        rows = self._rows(ego)
        if not rows or rows[0][0] != ego:
            return None
        ids = tuple(row[0] for row in rows)
        x, y, angle, speed, z = np.array([row[1:] for row in rows], float).T
        types = tuple(self._type(name) for name in ids)
        pose = from_sumo(SumoPose(x, y, angle), np.array([kind.length for kind in types]))
        centre_x, centre_y, yaw = (np.asarray(values) for values in pose)
        return Frame(time_s, ids, centre_x, centre_y, yaw, speed, z, types, self._shown(x[0], y[0]))

    def forget(self) -> None:
        """Cancel the subscription, unless the user's code has added to it."""
        lane, self._subscribed = self._subscribed, ""
        if not lane or any(
            told.keys() - _WANTED for told in self._sumo.lane.getContextSubscriptionResults(lane).values()
        ):
            return
        try:
            self._sumo.lane.unsubscribeContext(lane, tc.CMD_GET_VEHICLE_VARIABLE, self._radius_m)
        except Exception as error:  # gone, since the user's code has loaded a state of the simulation
            raise_unless_refused(error)

    def _rows(self, ego: str) -> list[tuple[Any, ...]]:
        """Name, x, y, angle, speed and z of all vehicles around, the ego first; empty where the ego is not there."""
        vehicle = self._sumo.vehicle
        if not self._in_process:
            told = self._told(ego)
            if told:
                return told
        names = vehicle.getIDList()
        if ego not in names:
            return []
        where = {name: vehicle.getPosition3D(name) for name in names}
        x, y, _ = where[ego]
        rows = []
        for name in (ego, *names):
            px, py, pz = where[name]
            if abs(px) > _NOWHERE_M or (name == ego and rows) or (px - x) ** 2 + (py - y) ** 2 > self._radius_m**2:
                continue
            rows.append((name, px, py, vehicle.getAngle(name), vehicle.getSpeed(name), pz))
        return rows

    def _told(self, ego: str) -> list[tuple[Any, ...]]:
        """The rows of `_rows` from a subscription; empty where there is none."""
        lanes, vehicle = self._sumo.lane, self._sumo.vehicle
        results = lanes.getContextSubscriptionResults(self._subscribed)
        if ego in results:
            lane = results[ego].get(tc.VAR_LANE_ID, "")
        else:
            lane = vehicle.getLaneID(ego) if ego in vehicle.getIDList() else ""
        if lane != self._subscribed:
            self.forget()
            results = lanes.getContextSubscriptionResults(lane)  # of another ego on this lane, or of the user's code
            if lane and not results:
                lanes.subscribeContext(lane, tc.CMD_GET_VEHICLE_VARIABLE, self._radius_m, list(_WANTED))
                self._subscribed = lane
                results = lanes.getContextSubscriptionResults(lane)
        if ego not in results or any(_WANTED - told.keys() for told in results.values()):
            return []
        x, y, _ = results[ego][tc.VAR_POSITION3D]
        rows = []
        for name in (ego, *(name for name in results if name != ego)):
            told = results[name]
            px, py, pz = told[tc.VAR_POSITION3D]
            if (px - x) ** 2 + (py - y) ** 2 <= self._radius_m**2:
                rows.append((name, px, py, told[tc.VAR_ANGLE], told[tc.VAR_SPEED], pz))
        return rows

    def _shown(self, x: float, y: float) -> dict[str, str]:
        reach = self._radius_m
        light = self._sumo.trafficlight
        return {
            name: light.getRedYellowGreenState(name)
            for name, (px, py) in self._lights.items()
            if abs(px - x) < reach and abs(py - y) < reach
        }

    def _type(self, name: str) -> VehicleType:
        if name not in self._types:
            vehicle = self._sumo.vehicle
            kind = vehicle.getVehicleClass(name)
            articulated = is_articulated(kind, vehicle.getShapeClass(name))
            self._types[name] = VehicleType(kind_of(kind), vehicle.getLength(name), vehicle.getWidth(name), articulated)
        return self._types[name]

    # --- before a plan ---------------------------------------------------------------------------

    def traffic(self, frame: Frame, most: int, horizon_s: float) -> TrafficState:
        """The ego and the nearest others, at most `most` in all, with their expected motion."""
        near = frame.nearest(most)
        kept = set(frame.ids) - {frame.ids[row] for row in near}  # the user's code may have changed those near since
        for known in (self._types, self._following):
            for name in known.keys() - kept:
                del known[name]
        if callable(self._route):
            self._known_route = KnownRoute(self._route(self._sumo), self.road)
        shows = {
            name: self._programmes.ahead(name, letters, frame.time_s, horizon_s)
            for name, letters in frame.lights.items()
        }
        self.routes.begin(shows)
        users = tuple(self._user(frame, row, horizon_s) for row in near)
        way = None if self._known_route is None else self._known_route.ahead(_front(frame, 0), float(frame.yaw[0]))
        return TrafficState(frame.time_s, users, self.road, shows, way)

    def _user(self, frame: Frame, index: int, horizon_s: float) -> RoadUser:
        name, kind = frame.ids[index], frame.types[index]
        x, y, yaw = (float(values[index]) for values in (frame.x, frame.y, frame.yaw))
        agent = Agent(name, kind.kind, kind.length, kind.width, "ego" if index == 0 else "background")
        speed = max(float(frame.speed[index]), 0.0)
        front = _front(frame, index)
        z = float(frame.z[index])
        path = None
        if index == 0 and self._known_route is not None:
            path = self._known_route.path(front, z, yaw, speed, horizon_s + REACH_S)
        if path is None:
            path = self.routes.path(name, front, yaw, speed, horizon_s, is_ego=index == 0)
        return RoadUser(agent, x, y, yaw, speed, path, self._follows(name), z, self._sumo.vehicle.getAcceleration(name))

    def _follows(self, name: str) -> Following:
        if name not in self._following:
            vehicle = self._sumo.vehicle
            sigma = vehicle.getImperfection(name)  # negative for all models but Krauss'
            self._following[name] = Following(
                accel=max(vehicle.getAccel(name), 0.1),
                decel=max(vehicle.getDecel(name), 0.5),
                tau_s=max(vehicle.getTau(name), 0.0),
                min_gap_m=max(vehicle.getMinGap(name), 0.0),
                speed_factor=max(vehicle.getSpeedFactor(name), 0.01),
                max_speed_m_s=max(vehicle.getMaxSpeed(name), 0.1),
                sigma=max(sigma, 0.0),
                model="krauss" if sigma >= 0.0 else "improved_idm",
            )
        return self._following[name]


def _front(frame: Frame, index: int) -> tuple[float, float]:
    """The middle of a vehicle's front bumper [m]."""
    nose = to_sumo(Pose(*(float(values[index]) for values in (frame.x, frame.y, frame.yaw))), frame.types[index].length)
    return float(nose.x), float(nose.y)
