"""Draws a vehicle by seed that the planner is to drive, where none is named."""

import math
import random
from collections.abc import Sequence
from typing import Any

from regents_cosim.scenario import VEHICLE_KINDS
from regents_cosim.sources.sumo_types import is_passenger_car, kind_of, vehicle_type_of

_FROM_S = (20.0, 40.0)  # range from which the seed draws the earliest departure
_AMONG = 3  # others within the radius, since most networks are empty at first
_DRAWN = 0.3  # share of the eligible vehicles that is drawn, so that seeds differ where a network fills slowly
_AMONG_WITHIN_S = 180.0  # if no passenger car was drawn for so long, the next vehicle is taken


class DrawnEgo:
    """Draws a vehicle that departs among others. Call `departed` after every step of the simulation."""

    def __init__(self, connection: Any, seed: int, radius_m: float) -> None:
        self._sumo, self._radius_m = connection, radius_m
        self._dice = random.Random(seed)
        self._from_s = float(connection.simulation.getTime()) + self._dice.uniform(*_FROM_S)

    def departed(self) -> str | None:
        """The drawn vehicle in the step in which it departs, else None; once no more vehicles will depart, one on the
        road.

        Passenger cars are preferred.
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
        """Whether a vehicle is drawn, and has enough of the vehicles in `there` around it."""
        vehicle = self._sumo.vehicle
        at = vehicle.getPosition(name)
        near = sum(math.dist(at, vehicle.getPosition(other)) < self._radius_m for other in there) - 1  # without itself
        return near >= _AMONG and self._dice.random() < _DRAWN

    def _is_car(self, name: str) -> bool:
        return is_passenger_car(vehicle_type_of(self._sumo.vehicle, name))

    def _is_vehicle(self, name: str) -> bool:
        return kind_of(self._sumo.vehicle.getVehicleClass(name)) in VEHICLE_KINDS
