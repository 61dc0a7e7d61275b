"""Which vehicle of a simulation the planner is to drive, where no vehicle is named: one drawn by seed."""

import math
import random
from collections.abc import Sequence
from typing import Any

from regents_cosim.scenario import VEHICLE_KINDS
from regents_cosim.sources.sumo_types import is_passenger_car, kind_of, vehicle_type_of

_FROM_S = (20.0, 40.0)  # after the begin, one time of these by seed: what departs earlier is not drawn
_AMONG = 3  # others within the radius: most networks are empty at first
_DRAWN = 0.3  # of those that depart among so many, so that seeds differ where a network fills slowly
_AMONG_WITHIN_S = 180.0  # where no passenger car was drawn for so long, the first vehicle after that is


class DrawnEgo:
    """One of those that depart among others. Ask after every step of the simulation."""

    def __init__(self, connection: Any, seed: int, radius_m: float) -> None:
        self._sumo, self._radius_m = connection, radius_m
        self._dice = random.Random(seed)
        self._from_s = float(connection.simulation.getTime()) + self._dice.uniform(*_FROM_S)

    def departed(self) -> str | None:
        """It, in the step in which it departs; one on the road as soon as no vehicle will depart any more.

        Passenger cars come before all others.
        """
        now = float(self._sumo.simulation.getTime())
        if now < self._from_s:
            return None
        there = self._sumo.vehicle.getIDList()
        if self._sumo.simulation.getMinExpectedNumber() <= len(there):
            left = [name for name in there if self._is_vehicle(name)]
            left = list(filter(self._is_car, left)) or left
            return self._dice.choice(left) if left else None
        departed = (name for name in self._sumo.simulation.getDepartedIDList() if self._is_vehicle(name))
        anyone = now > self._from_s + _AMONG_WITHIN_S
        return next((name for name in departed if anyone or (self._is_drawn(name, there) and self._is_car(name))), None)

    def _is_drawn(self, name: str, there: Sequence[str]) -> bool:
        """Of those that depart among enough of the vehicles that are `there`."""
        vehicle = self._sumo.vehicle
        at = vehicle.getPosition(name)
        near = sum(math.dist(at, vehicle.getPosition(other)) < self._radius_m for other in there) - 1  # but itself
        return near >= _AMONG and self._dice.random() < _DRAWN

    def _is_car(self, name: str) -> bool:
        return is_passenger_car(vehicle_type_of(self._sumo.vehicle, name))

    def _is_vehicle(self, name: str) -> bool:
        return kind_of(self._sumo.vehicle.getVehicleClass(name)) in VEHICLE_KINDS
