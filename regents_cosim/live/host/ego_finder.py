"""Finds the ego in a running simulation."""

from collections.abc import Callable
from typing import Any

from regents_cosim.errors import SumoError
from regents_cosim.sources.recording import matches_vehicle

Picks = str | Callable[[Any], str | None]

_NOT_ON_ROADS = ("rail", "tram", "subway", "ship", "cable_car")  # prefixes of these vehicle classes


class EgoFinder:
    """Waits for the ego, given by an id, by a type or flow (whose first vehicle is taken), or by a function."""

    def __init__(self, connection: Any, picks: Picks, is_free: Callable[[str], bool]) -> None:
        """`is_free` tells whether a vehicle may be taken as ego by its type or flow."""
        self._sumo, self._picks, self._is_free = connection, picks, is_free
        self.start()

    def start(self) -> None:
        """Check all vehicles that are present; afterwards only departing ones are checked."""
        self._looked = False

    def find(self) -> str | None:
        """The ego; None where it has not departed. Raises SumoError for a vehicle on rails or water."""
        picked = self._picks(self._sumo) if callable(self._picks) else self._by_name(self._picks)
        if picked is None or picked not in self._sumo.vehicle.getIDList():
            return None
        kind = self._sumo.vehicle.getVehicleClass(picked)
        if kind.startswith(_NOT_ON_ROADS):
            raise SumoError(f"the ego {picked!r} is of the class {kind}: not supported on rails or water")
        return picked

    def _by_name(self, name: str) -> str | None:
        """The vehicle with that id, else the first of that type or flow."""
        vehicle = self._sumo.vehicle
        there = vehicle.getIDList()
        if name in there:
            return name
        new = self._sumo.simulation.getDepartedIDList() if self._looked else there
        self._looked = True
        called = (one for one in new if matches_vehicle(name, one, vehicle.getTypeID(one)))
        return next((one for one in called if self._is_free(one)), None)
