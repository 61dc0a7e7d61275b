"""SUMO as the host simulation of a live attack."""

from collections.abc import Callable
from typing import Any

from regents_cosim.live.frame import Frame
from regents_cosim.live.reading import SimulationReader
from regents_cosim.live.traffic import TrafficState
from regents_cosim.live.vehicle_control import SumoVehicleControl

_STOPPED = 1  # bit of a vehicle's stop state


class SumoHost:
    """A simulation that is read through TraCI or libsumo, and whose vehicles can be controlled."""

    def __init__(self, connection: Any, reader: SimulationReader, is_free: Callable[[str], bool]) -> None:
        """`is_free` tells whether no adversary claims a vehicle."""
        self._sumo, self._reader, self._is_free = connection, reader, is_free
        self.road, self.step_s, self.speed_only = reader.road, reader.step_s, reader.sideways

    def traffic(self, frame: Frame, most: int, horizon_s: float) -> TrafficState:
        """The ego and the nearest others, at most `most` in all, with their expected motion."""
        return self._reader.traffic(frame, most, horizon_s)

    def is_at_stop(self, name: str) -> bool:
        """Whether a vehicle waits at a scheduled stop, or is parked."""
        return bool(self._sumo.vehicle.getStopState(name) & _STOPPED)

    def is_spared(self, name: str) -> bool:
        """Whether a vehicle is an ego, controlled by another adversary, or to be spared."""
        return not self._is_free(name)

    def take(self, name: str, length_m: float) -> SumoVehicleControl:
        """Take control of a vehicle."""
        return SumoVehicleControl(self._sumo, name, length_m, self.road, self.speed_only)
