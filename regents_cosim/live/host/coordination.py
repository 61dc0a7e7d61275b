"""Coordinates several adversaries and egos in one simulation, so that they do not take each other's vehicles.

There is one `Coordination` for each running simulation. Members join when they are created, and leave when they are
detached.
"""

import sys
from collections.abc import Callable, Collection
from contextlib import suppress
from functools import cache
from types import ModuleType
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

from regents_cosim.simulators.sumo.closing import is_libsumo, tell_at_close
from regents_cosim.sources.recording import matches_vehicle

if TYPE_CHECKING:
    from regents_cosim.live.adversary import Adversary

Spare = str | Collection[str] | Callable[[str], bool]


class Coordination:
    """The members of one simulation."""

    def __init__(self) -> None:
        self._members: dict[Adversary, int] = {}  # member: number of the run in which it was created
        self._run, self._now_s = 0, -float("inf")
        self.held_s: dict[str, float] = {}  # when each vehicle was controlled last [s]

    @staticmethod
    def of(simulation: Any) -> "Coordination":
        """The coordination of a simulation, given as `simulation_of` returns it."""
        known = _KNOWN.setdefault(simulation, Coordination())
        tell_at_close(simulation, known.close)
        return known

    def join(self, member: "Adversary", connection: Any) -> None:
        """Add a member; members from before a restart of the simulation are removed."""
        with suppress(Exception):  # not started yet; TraCI's errors have no common class
            self.saw(float(connection.simulation.getTime()))
        for old in [one for one, run in self._members.items() if run < self._run]:
            old.closed()
        self._members[member] = self._run

    def leave(self, member: "Adversary") -> None:
        """Remove a member."""
        self._members.pop(member, None)

    def saw(self, now_s: float) -> None:
        """Note the simulation time; if it goes back, another run has begun."""
        if now_s < self._now_s:
            self._run += 1
            self.held_s.clear()
        self._now_s = now_s

    def held_within(self, seconds: float, name: str) -> bool:
        """Whether a member has controlled a vehicle within the last `seconds` [s]."""
        return self._now_s - self.held_s.get(name, -float("inf")) <= seconds

    def is_free(self, name: str) -> bool:
        """Whether no member claims a vehicle."""
        return not any(member.claims(name) for member in self._members)

    def make_ego(self, name: str) -> None:
        """Make all members release a vehicle that has become an ego."""
        for member in list(self._members):
            member.give_up(name)

    def close(self) -> None:
        """The simulation was closed."""
        for member in list(self._members):
            member.closed()
        self._members.clear()
        self._now_s = -float("inf")


def spares(connection: Any, spare: Spare) -> Callable[[str], bool]:
    """A function that tells whether a vehicle is one of `spare`: ids, types or flows, or a function of the id."""
    if callable(spare):
        return spare
    names = (spare,) if isinstance(spare, str) else tuple(spare)

    @cache
    def is_spared(name: str) -> bool:
        kind = connection.vehicle.getTypeID(name) if names else ""
        return any(matches_vehicle(one, name, kind) for one in names)

    return is_spared


_KNOWN: WeakKeyDictionary[Any, Coordination] = WeakKeyDictionary()


def simulation_of(connection: Any) -> Any:
    """The connection to the simulation behind `connection`, since several names may lead to it.

    `traci` itself leads to another one once the user's code calls `traci.switch`.
    """
    if is_libsumo(connection):
        return sys.modules["libsumo"]
    if not isinstance(connection, ModuleType):
        return connection
    try:
        return connection.getConnection(connection.getLabel())
    except Exception:  # not started, or without a label; TraCI's errors have no common class
        return connection
