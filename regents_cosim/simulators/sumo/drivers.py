"""The agents that a replay lets SUMO drive, and their drivers.

Attributes of a vType: https://sumo.dlr.de/docs/Definition_of_Vehicles,_Vehicle_Types,_and_Routes.html Modes:
https://sumo.dlr.de/docs/TraCI/Change_Vehicle_State.html
"""

from collections.abc import Collection
from xml.etree import ElementTree

import numpy as np

from regents_cosim.norms.limits import STANDING_M_S
from regents_cosim.scenario import VEHICLE_KINDS, Agent, Scenario

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
