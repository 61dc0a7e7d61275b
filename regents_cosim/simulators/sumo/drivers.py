"""The agents of a replay in SUMO: those that SUMO drives, with their drivers, and pedestrians as its own persons.

Attributes of a vType: https://sumo.dlr.de/docs/Definition_of_Vehicles,_Vehicle_Types,_and_Routes.html Modes:
https://sumo.dlr.de/docs/TraCI/Change_Vehicle_State.html
"""

from collections.abc import Collection
from types import ModuleType
from xml.etree import ElementTree

import numpy as np

from regents_cosim.geometry.frames import Pose, SumoPose, from_sumo
from regents_cosim.norms.limits import STANDING_M_S
from regents_cosim.scenario.scenario import VEHICLE_KINDS, Agent, Scenario

SPEED_MODE = 31  # of a driver: all checks
LANE_CHANGE_MODE = 1621  # all reasons for lane changes, into sufficient gaps


def background_drivers(scenario: Scenario) -> frozenset[int]:
    """The vehicles that SUMO drives, by index: all but the ego, the adversary and those that never move.

    A vehicle may stand during the whole log because of something outside the scene: a queue further on, or others with
    right of way. SUMO would start it.
    """
    tracks = scenario.tracks
    moves = tracks.valid & (tracks.speed > STANDING_M_S)
    stands = np.array([there.any() and not moved.any() for there, moved in zip(tracks.valid, moves, strict=True)])
    return frozenset(
        index
        for index, agent in enumerate(scenario.agents)
        if index > 0 and agent.role != "adversary" and agent.kind in VEHICLE_KINDS and not stands[index]
    )


def type_file(agents: tuple[Agent, ...], driven: Collection[int]) -> bytes:
    """An additional file with a vType for each agent that SUMO drives, as its passenger car but for the size."""
    root = ElementTree.Element("additional")
    for index in driven:
        size = {"length": repr(float(agents[index].length)), "width": repr(float(agents[index].width))}
        ElementTree.SubElement(root, "vType", {"id": driven_type(index), **size})
    return ElementTree.tostring(root)


def driven_type(index: int) -> str:
    """The name of the vType of a driven agent."""
    return f"driven{index}"


# --- persons ------------------------------------------------------------------------------------

# Places the pedestrians of a replay at every step as SUMO's own persons.
#
# `person.moveToXY` maps a position onto the lanes around it, and then reports the position along that lane. On the
# walking areas at junctions that is wrong now and then, and SUMO 1.28.0 may end in a segmentation fault. If it may map
# onto no lane, every position is exact: on sidewalks, walking areas, crossings, the carriageway and off the road.
#
# The price: SUMO's drivers do not see a person that is on no lane. They stop for a person that is mapped onto a
# crossing, but drive through one on the carriageway, mapped or not, and SUMO lists no collision. So where SUMO drives
# others, pedestrians are vehicles of a pedestrian's size, for which its drivers brake.
_EXACT = 2  # keepRoute of moveToXY: this exact position, on any edge or on none
_ONTO_NO_LANE = -1.0  # [m] largest distance of a lane to map onto
_FOR_EVER_S = 1e6


def moved_as_persons(scenario: Scenario, sumo_drives: Collection[int]) -> frozenset[int]:
    """The indices of agents that are persons in SUMO; none where SUMO drives others, who would not see them."""
    if sumo_drives:
        return frozenset()
    return on_foot(scenario)


def on_foot(scenario: Scenario) -> frozenset[int]:
    """The indices of all pedestrians but the ego."""
    return frozenset(index for index, agent in enumerate(scenario.agents) if index > 0 and agent.kind == "pedestrian")


class Persons:
    """The persons of a running simulation."""

    def __init__(self, sumo: ModuleType, edge: str) -> None:
        """`edge` is any edge of the network, since every person departs from one."""
        self._person, self._edge = sumo.person, edge

    def enter(self, name: str, type_name: str, colour: tuple[int, int, int]) -> None:
        """Add a person to the simulation; it does not move by itself."""
        self._person.add(name, self._edge, 0.0, typeID=type_name)
        self._person.appendWaitingStage(name, _FOR_EVER_S)
        self._person.setColor(name, colour)

    def place(self, name: str, x: float, y: float, angle: float) -> None:
        """Set the position after the next step, in SUMO's terms."""
        self._person.moveToXY(name, "", x, y, angle, _EXACT, _ONTO_NO_LANE)

    def remove(self, name: str) -> None:
        """Remove a person; does nothing for one that is gone."""
        if name in self._person.getIDList():
            self._person.remove(name)

    def there(self) -> set[str]:
        """The names of the persons in the simulation."""
        return set(self._person.getIDList())

    def pose(self, name: str, length: float) -> Pose:
        """The pose of the centre of a person's box."""
        x, y = self._person.getPosition(name)
        return from_sumo(SumoPose(x, y, self._person.getAngle(name)), length)
