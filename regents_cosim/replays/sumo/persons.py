"""Pedestrians of a replay as SUMO's own persons, placed at every step.

`person.moveToXY` maps a place onto the lanes around it, and then tells where along which lane that is. On the walking
areas at junctions that is wrong: of 12,000 steps of random walks around a junction with crossings 51 came back up to
0.6 m off, and 3 of 4 processes ended in a segmentation fault (SUMO 1.28.0). Where it may map onto no lane, 48,000 of
48,000 came back exact, on sidewalks, walking areas, crossings, the carriageway and off the road.

The price: SUMO's own drivers do not see a person that is on no lane. They stop for one that is mapped onto a crossing,
but drive through one on the carriageway, mapped or not, and SUMO lists no collision. So where SUMO drives others,
pedestrians stay vehicles of their size, for which its drivers brake.
"""

from collections.abc import Collection
from types import ModuleType

from regents_cosim.geometry.frames import Pose, SumoPose, from_sumo
from regents_cosim.scenario import Scenario

_EXACT = 2  # keepRoute of moveToXY: this very position, on any edge or on none
_ONTO_NO_LANE = -1.0  # [m] from which a lane may be
_FOR_EVER_S = 1e6


def moved_as_persons(scenario: Scenario, sumo_drives: Collection[int]) -> frozenset[int]:
    """The agents, by index, that are persons in SUMO; none where it drives others, who would not see them."""
    if sumo_drives:
        return frozenset()
    return frozenset(index for index, agent in enumerate(scenario.agents) if index > 0 and agent.kind == "pedestrian")


class Persons:
    """The persons of a running simulation."""

    def __init__(self, sumo: ModuleType, edge: str) -> None:
        """`edge` is any of the network: every person departs from one."""
        self._person, self._edge = sumo.person, edge

    def enter(self, name: str, type_name: str, colour: tuple[int, int, int, int]) -> None:
        """Put a person into the simulation; it goes nowhere by itself."""
        self._person.add(name, self._edge, 0.0, typeID=type_name)
        self._person.appendWaitingStage(name, _FOR_EVER_S)
        self._person.setColor(name, colour)

    def place(self, name: str, x: float, y: float, angle: float) -> None:
        """Where it is after the next step, in SUMO's terms."""
        self._person.moveToXY(name, "", x, y, angle, _EXACT, _ONTO_NO_LANE)

    def remove(self, name: str) -> None:
        """Take it out; once it is gone that does no harm."""
        if name in self._person.getIDList():
            self._person.remove(name)

    def there(self) -> set[str]:
        """Who is in the simulation."""
        return set(self._person.getIDList())

    def pose(self, name: str, length: float) -> Pose:
        """The centre of its box."""
        x, y = self._person.getPosition(name)
        return from_sumo(SumoPose(x, y, self._person.getAngle(name)), length)
