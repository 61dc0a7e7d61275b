"""Controls one vehicle of a running simulation: places it at every step, and finally restores it.

`moveToXY` with keepRoute 3 puts it exactly where it should be and leaves its route alone; traffic at a junction sees it
only there (SUMO issue 6140). With continuous lane changes or the sublane model that crashes SUMO 1.28: there the
vehicle keeps to its lane, and only its speed is controlled.
"""

from typing import Any

import numpy as np

from regents_cosim.geometry.frames import Pose, to_sumo
from regents_cosim.geometry.lines import distances_along, points_at, stretch
from regents_cosim.live.host.interface import OFF_LANE_M
from regents_cosim.live.host.vehicle_route import VehicleRoute, raise_unless_refused
from regents_cosim.live.predict.paths import LaneChains
from regents_cosim.live.search.plan import Plan
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.routes.lane_matching import match_lanes
from regents_cosim.simulators import COLOURS

_EXACT_ON_ROUTE = 3
_ONTO_LANE = 1  # keepRoute: the nearest place in the middle of a lane of its route
_UNCHECKED = 0  # speed and lane change modes: only obey commands
_AS_SUMO_LIKES = -1.0
_POINTS_M = 5.0  # distance between the points of a plan whose edges are looked up
_ROUNDED_M_S = 1e-3
_STOP_LINE_M = 1.0  # SUMO has vehicles wait this far before the end of a lane (jmStoplineGap)
# Its own driver may brake as in an emergency, and EIDM even stops within a step, before it has adapted to where it was
# placed. Given back on `grid` without a reason to brake, 18 of 279 vehicles did in their first seconds, with this 3 of
# 247 (IDM: 29 of 200, and 1 of 183).
HELD_S = 2.0
_SAFE = 0b101  # bits of the speed mode: keep safe, brake by at most `decel`
_GOES_FIRST = "MGO"  # letters of a link on which a vehicle never gives way


class SumoVehicleControl:
    """Controls one vehicle until it is released."""

    def __init__(
        self,
        connection: Any,
        name: str,
        length_m: float,
        road: RoadMap,
        only_speed: bool = False,
        colour: tuple[int, ...] = COLOURS["adversary"],
    ) -> None:
        self._sumo, self.name, self._length_m = connection, name, length_m
        self._road, self._only_speed = road, only_speed
        self._step_s = float(connection.simulation.getDeltaT())
        vehicle = connection.vehicle
        self._modes = int(vehicle.getSpeedMode(name)), int(vehicle.getLaneChangeMode(name))
        self._colour, self._route = tuple(vehicle.getColor(name)), VehicleRoute(connection, name)
        vehicle.setSpeedMode(name, _UNCHECKED)
        vehicle.setLaneChangeMode(name, _UNCHECKED)
        vehicle.setColor(name, colour)
        self._shown = tuple(vehicle.getColor(name))
        self._told_m_s: float | None = None

    def follow_route_of(self, plan: Plan) -> None:
        """Set the vehicle's route to the path of the plan, so that others at a junction see it coming."""
        if self._only_speed:
            return
        self._route.lead_along(self._edges(plan))

    def confirm(self) -> None:
        """Set the speed again after a step, since SUMO resets it when a vehicle enters another lane."""
        if self._told_m_s is not None and not self._only_speed:
            self._sumo.vehicle.setPreviousSpeed(self.name, self._told_m_s)

    def place(self, x: float, y: float, yaw: float, speed: float) -> None:
        """Set the centre [m], the yaw [rad] and the speed [m/s] for the next step."""
        vehicle, speed = self._sumo.vehicle, max(float(speed), 0.0)
        if not self._only_speed:
            front_x, front_y, angle = to_sumo(Pose(x, y, yaw), self._length_m)
            vehicle.moveToXY(self.name, "", -1, float(front_x), float(front_y), float(angle), _EXACT_ON_ROUTE)
        vehicle.setSpeed(self.name, speed)
        self._told_m_s = speed

    def give_back(self) -> bool:
        """Restore the modes, colour, route and stops that the user has not changed; False if the vehicle has gone.

        For one more step the vehicle keeps its speed, in the middle of its lane. SUMO computes the speed of a placed
        vehicle from its displacement: without a displacement it would brake as in an emergency. For `HELD_S` SUMO has
        it drive at most at that speed, as is safe, and brake by at most its `decel`. Afterwards its driver decides.
        """
        vehicle = self._sumo.vehicle
        if self.name not in vehicle.getIDList():
            return False
        self._route.give_back()
        if self._told_m_s is None:
            vehicle.setSpeed(self.name, _AS_SUMO_LIKES)
        else:
            if not self._only_speed:
                self._onto_lane()
            is_safe = self._modes[0] & _SAFE == _SAFE
            held_s = max(HELD_S, self._step_s) if is_safe else self._step_s
            vehicle.slowDown(self.name, vehicle.getSpeed(self.name), held_s)
        if vehicle.getSpeedMode(self.name) == _UNCHECKED:
            vehicle.setSpeedMode(self.name, self._modes[0])
        if vehicle.getLaneChangeMode(self.name) == _UNCHECKED:
            vehicle.setLaneChangeMode(self.name, self._modes[1])
        if tuple(vehicle.getColor(self.name)) == self._shown:
            vehicle.setColor(self.name, self._colour)
        return True

    def is_at_ease(self) -> bool:
        """Whether its front is near the middle of its lane, and SUMO would brake it by at most its `decel`, now and at
        the next place where it may wait.
        """
        vehicle = self._sumo.vehicle
        if abs(float(vehicle.getLateralLanePosition(self.name))) >= OFF_LANE_M:
            return False
        speed, decel = float(vehicle.getSpeed(self.name)), float(vehicle.getDecel(self.name))
        if vehicle.getSpeedWithoutTraCI(self.name) < speed - decel * self._step_s - _ROUNDED_M_S:
            return False
        stops_m = speed * self._step_s + 0.5 * speed**2 / decel + _STOP_LINE_M
        return self._may_wait_in_m() > stops_m

    def _may_wait_in_m(self) -> float:
        """The distance to the next line where it may have to give way [m]."""
        vehicle = self._sumo.vehicle
        lane = vehicle.getLaneID(self.name)
        if lane not in self._road.lane:
            return np.inf
        links = vehicle.getNextLinks(self.name)
        if self._road.lane[lane].junction:  # it may have to wait within the junction
            waits = any(self._road.lane[link.target].junction for link in self._road.exits[lane])
        else:
            waits = bool(links) and links[0][5] not in _GOES_FIRST
        return self._road.lane[lane].length - float(vehicle.getLanePosition(self.name)) if waits else np.inf

    def _onto_lane(self) -> None:
        """Put it onto the nearest lane of its route, one step ahead."""
        vehicle = self._sumo.vehicle
        angle, way_m = float(vehicle.getAngle(self.name)), float(vehicle.getSpeed(self.name)) * self._step_s
        lane, along_m = vehicle.getLaneID(self.name), float(vehicle.getLanePosition(self.name))
        if lane in self._road.lane and along_m + way_m < self._road.lane[lane].length:
            x, y = stretch(self._road.lane[lane].centre, along_m + way_m)[0].tolist()
        else:
            (x, y), turned = vehicle.getPosition(self.name), np.deg2rad(90.0 - angle)
            x, y = float(x + way_m * np.cos(turned)), float(y + way_m * np.sin(turned))
        try:
            vehicle.moveToXY(self.name, "", -1, x, y, angle, _ONTO_LANE)
        except Exception as error:  # too far from its route
            raise_unless_refused(error)

    def _edges(self, plan: Plan) -> list[str]:
        """The edges under a plan up to a little after the contact with the ego.

        A plan that ends in a junction leads to the edge of its turn.
        """
        points = np.stack([plan.x, plan.y], axis=1)
        driven = distances_along(*points.T)
        at = np.arange(0.0, driven[-1], _POINTS_M)
        if len(at) < 2:
            return []
        sparse = points_at(at, driven, points)
        lanes = [lane for lane in match_lanes(self._road, sparse, np.zeros(len(sparse))) if lane is not None]
        names = [lane.id for lane in lanes if not lane.junction]
        names += LaneChains(self._road).out_of_junction(lanes[-1].id)[-1:] if lanes else []
        return list(dict.fromkeys(name.rpartition("_")[0] for name in names))
