"""Changes the route and the stops of one vehicle for an attack, and restores them.

SUMO removes a stop when the new route does not pass it, and TraCI has no call that restores it. So all that TraCI tells
of a stop is read before, and set again.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from traci import constants as tc

_AT_PLACE = tc.STOP_BUS_STOP | tc.STOP_CONTAINER_STOP | tc.STOP_CHARGING_STATION | tc.STOP_PARKING_AREA
_AT_PLACE |= tc.STOP_OVERHEAD_WIRE  # such stops are named by their place, others by their edge
_TOLD = (
    "posLat", "extension", "triggered", "expected", "expectedContainers", "permitted", "parking", "actType", "tripId",
    "split", "join", "line", "speed", "onDemand", "jump", "jumpUntil", "arrival",
)  # fmt: skip


@dataclass(frozen=True)
class StopFound:
    """A stop ahead of a vehicle."""

    edge: str
    lane: int
    place: str  # the bus stop, parking area or the like, if any
    start_m: float
    end_m: float
    flags: int
    duration_s: float
    until_s: float
    told: tuple[tuple[str, str], ...]  # further attributes, by their names in SUMO


class VehicleRoute:
    """The route and stops of one vehicle, as they are when this is created, until `give_back`."""

    def __init__(self, connection: Any, name: str) -> None:
        self._sumo, self._name = connection, name
        vehicle = connection.vehicle
        self._id, self._found = str(vehicle.getRouteID(name)), list(vehicle.getRoute(name))
        self._ahead = self._found[max(vehicle.getRouteIndex(name), 0) :]
        self._ours: list[str] | None = None  # the route that was set last
        self._lost: list[StopFound] = []

    def lead_along(self, edges: Sequence[str]) -> None:
        """Let the vehicle follow some edges, and then continue by its next stop to its old destination."""
        vehicle = self._sumo.vehicle
        ahead = list(vehicle.getRoute(self._name))[max(vehicle.getRouteIndex(self._name), 0) :]
        if not edges or not ahead or _runs_along(edges, ahead):
            return
        edges = edges[edges.index(ahead[0]) :] if ahead[0] in edges else [ahead[0], *edges]
        self._change([*edges, *self._onward(edges[-1])])

    def give_back(self) -> None:
        """Restore route and stops; a vehicle off its old route keeps the new one, which leads back there."""
        vehicle = self._sumo.vehicle
        now = list(vehicle.getRoute(self._name))
        if self._ours is None or now != self._ours:
            return  # never changed, or changed by others since
        here = now[max(vehicle.getRouteIndex(self._name), 0)]
        if here in self._ahead:
            rest = self._ahead[self._ahead.index(here) :]
            is_whole = self._found[self._found.index(here) :] == rest
            if not (is_whole and self._try(lambda: vehicle.setRouteID(self._name, self._id))):
                self._try(lambda: vehicle.setRoute(self._name, rest))
        for stop in self._lost:
            self._give_stop(stop)
        self._ours, self._lost = None, []

    def _change(self, route: list[str]) -> None:
        """Change the route, and remember the stops that are lost by it."""
        before = self._stops()
        if self._try(lambda: self._sumo.vehicle.setRoute(self._name, route)):
            self._ours = list(self._sumo.vehicle.getRoute(self._name))
            left = self._stops()
            self._lost += [stop for stop in before if stop not in left]

    def _onward(self, edge: str) -> list[str]:
        """The edges after one, by the next stop that can be reached, to the end of the original route."""
        kind = self._sumo.vehicle.getTypeID(self._name)
        for target in (*(stop.edge for stop in (*self._lost, *self._stops())), self._ahead[-1]):
            if target not in self._ahead:
                continue
            way = list(self._sumo.simulation.findRoute(edge, target, kind).edges)
            if way:
                return [*way[1:], *self._ahead[self._ahead.index(target) + 1 :]]
        return []

    def _stops(self) -> list[StopFound]:
        """The stops ahead, in order."""
        vehicle = self._sumo.vehicle
        found = []
        for index, stop in enumerate(vehicle.getStops(self._name, 0)):
            told = ((key, self._told(index, key)) for key in _TOLD)
            edge, _, lane = stop.lane.rpartition("_")
            found.append(
                StopFound(
                    edge, int(lane), stop.stoppingPlaceID, stop.startPos, stop.endPos, stop.stopFlags,
                    stop.duration, stop.until, tuple((key, value) for key, value in told if value is not None),
                )
            )  # fmt: skip
        return found

    def _told(self, index: int, key: str) -> str | None:
        """An attribute of a stop; None where this version of SUMO does not have it."""
        try:
            return str(self._sumo.vehicle.getStopParameter(self._name, index, key))
        except Exception as error:
            raise_unless_refused(error)
            return None

    def _give_stop(self, stop: StopFound) -> None:
        """Set a stop again; one that lies behind by now counts as past."""
        vehicle = self._sumo.vehicle
        where = stop.place if stop.flags & _AT_PLACE else stop.edge
        if not self._try(
            lambda: vehicle.setStop(
                self._name, where, stop.end_m, stop.lane, stop.duration_s, stop.flags, stop.start_m, stop.until_s
            )
        ):
            return
        place = (stop.edge, stop.start_m, stop.end_m)
        index = [(one.edge, one.start_m, one.end_m) for one in self._stops()].index(place)
        for key, value in stop.told:
            if value != self._told(index, key):
                self._try(lambda key=key, value=value: vehicle.setStopParameter(self._name, index, key, value))

    def _try(self, change: Callable[[], Any]) -> bool:
        """Try a change, and return whether SUMO accepts it: it refuses a disconnected route, or a stop that lies
        behind.
        """
        try:
            change()
        except Exception as error:
            raise_unless_refused(error)
            return False
        return True


def raise_unless_refused(error: Exception) -> None:
    """Raise an error that is not SUMO's refusal; libsumo and traci each have a class for that, of the same name."""
    if type(error).__name__ != "TraCIException":
        raise error


def _runs_along(edges: Sequence[str], route: Sequence[str]) -> bool:
    """Whether the edges occur in a route, in order."""
    left = iter(route)
    return all(edge in left for edge in edges)
