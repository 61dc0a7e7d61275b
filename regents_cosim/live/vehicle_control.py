"""One vehicle of a running simulation in our hands: placed at every step, and given back as it was found.

`moveToXY` with keepRoute 3 puts it exactly where it should be and leaves its route alone; junction foes see it only
there (SUMO issue 6140). Where lanes are changed over time or the sublane model is on, that makes SUMO 1.28 crash: there
the vehicle keeps to its lane, and its speed alone is ours.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from regents_cosim.geometry.frames import Pose, to_sumo
from regents_cosim.live.paths import LaneChains
from regents_cosim.live.plan import Plan
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.routes.lane_matching import match_lanes

ADVERSARY_COLOUR = (213, 94, 0, 255)
_EXACT_ON_ROUTE = 3
_ONTO_LANE = 1  # keepRoute: the nearest place in the middle of a lane of its route
_UNCHECKED = 0  # speed and lane changes: nothing but what it is told
_AS_SUMO_LIKES = -1.0
_POINTS_M = 5.0  # of a plan, by which its edges are told


@dataclass(frozen=True)
class _Found:
    """How a vehicle was."""

    speed_mode: int
    lane_change_mode: int
    colour: tuple[int, ...]
    route: tuple[str, ...]


class SumoVehicleControl:
    """Holds one vehicle until it is given back."""

    def __init__(
        self,
        connection: Any,
        name: str,
        length_m: float,
        road: RoadMap,
        only_speed: bool = False,
        colour: tuple[int, ...] = ADVERSARY_COLOUR,
    ) -> None:
        self._sumo, self.name, self._length_m = connection, name, length_m
        self._road, self._only_speed = road, only_speed
        vehicle = connection.vehicle
        self._found = _Found(
            vehicle.getSpeedMode(name),
            vehicle.getLaneChangeMode(name),
            tuple(vehicle.getColor(name)),
            tuple(vehicle.getRoute(name)),
        )
        vehicle.setSpeedMode(name, _UNCHECKED)
        vehicle.setLaneChangeMode(name, _UNCHECKED)
        vehicle.setColor(name, colour)
        self._told_m_s: float | None = None

    def follow_route_of(self, plan: Plan) -> None:
        """Let the vehicle's route be the way of the plan, so that others at a junction see it come."""
        if self._only_speed:
            return
        edges = self._edges(plan)
        route = list(self._sumo.vehicle.getRoute(self.name))
        index = max(self._sumo.vehicle.getRouteIndex(self.name), 0)
        ahead = route[index:]
        if not edges or not ahead or _runs_along(edges, ahead):
            return
        edges = edges[edges.index(ahead[0]) :] if ahead[0] in edges else [ahead[0], *edges]
        kind = self._sumo.vehicle.getTypeID(self.name)
        onward = self._sumo.simulation.findRoute(edges[-1], self._found.route[-1], kind).edges[1:]
        self._try(lambda: self._sumo.vehicle.setRoute(self.name, [*edges, *onward]))

    def confirm(self) -> None:
        """After a step: SUMO forgets the speed of one that comes onto another lane."""
        if self._told_m_s is not None and not self._only_speed:
            self._sumo.vehicle.setPreviousSpeed(self.name, self._told_m_s)

    def place(self, x: float, y: float, yaw: float, speed: float) -> None:
        """Where its centre [m] is to be after the next step, how it is turned [rad], and how fast it goes [m/s]."""
        vehicle, speed = self._sumo.vehicle, max(float(speed), 0.0)
        if not self._only_speed:
            front_x, front_y, angle = to_sumo(Pose(x, y, yaw), self._length_m)
            vehicle.moveToXY(self.name, "", -1, float(front_x), float(front_y), float(angle), _EXACT_ON_ROUTE)
        vehicle.setSpeed(self.name, speed)
        self._told_m_s = speed

    def give_back(self) -> bool:
        """As it was found: modes, colour and route; False where it has gone, and needs nothing."""
        vehicle = self._sumo.vehicle
        if self.name not in vehicle.getIDList():
            return False
        if not self._only_speed and self._told_m_s is not None:
            x, y = vehicle.getPosition(self.name)
            self._try(lambda: vehicle.moveToXY(self.name, "", -1, x, y, vehicle.getAngle(self.name), _ONTO_LANE))
        vehicle.setSpeed(self.name, _AS_SUMO_LIKES)
        vehicle.setSpeedMode(self.name, self._found.speed_mode)
        vehicle.setLaneChangeMode(self.name, self._found.lane_change_mode)
        vehicle.setColor(self.name, self._found.colour)
        self._route_as_found()
        return True

    def off_lane_m(self) -> float:
        """How far its front is from the middle of the lane that SUMO has it on [m]."""
        return abs(float(self._sumo.vehicle.getLateralLanePosition(self.name)))

    def _route_as_found(self) -> None:
        vehicle, found = self._sumo.vehicle, self._found.route
        now = list(vehicle.getRoute(self.name))
        here = now[max(vehicle.getRouteIndex(self.name), 0)] if now else ""
        if here in found and now[max(vehicle.getRouteIndex(self.name), 0) :] != list(found[found.index(here) :]):
            self._try(lambda: vehicle.setRoute(self.name, list(found[found.index(here) :])))

    def _edges(self, plan: Plan) -> list[str]:
        """The edges under a plan up to where it meets the ego and a little further.

        One that ends in a junction leads to the edge of its turn.
        """
        points = np.stack([plan.x, plan.y], axis=1)
        driven = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
        at = np.arange(0.0, driven[-1], _POINTS_M)
        if len(at) < 2:
            return []
        sparse = np.stack([np.interp(at, driven, values) for values in points.T], axis=1)
        lanes = [lane for lane in match_lanes(self._road, sparse, np.zeros(len(sparse))) if lane is not None]
        names = [lane.id for lane in lanes if not lane.junction]
        names += LaneChains(self._road).out_of_junction(lanes[-1].id)[-1:] if lanes else []
        return list(dict.fromkeys(name.rpartition("_")[0] for name in names))

    def _try(self, change: Any) -> None:
        """What SUMO may refuse without harm: a route that does not join, a place too far from one."""
        try:
            change()
        except Exception as error:
            if type(error).__name__ != "TraCIException":
                raise


def _runs_along(edges: Sequence[str], route: Sequence[str]) -> bool:
    """Whether the edges are among those of a route, in order."""
    left = iter(route)
    return all(edge in left for edge in edges)
