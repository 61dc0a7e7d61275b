"""The agents that a replay lets SUMO drive, and the parameters of SUMO's driver models.

Attributes of a vType: https://sumo.dlr.de/docs/Definition_of_Vehicles,_Vehicle_Types,_and_Routes.html Modes:
https://sumo.dlr.de/docs/TraCI/Change_Vehicle_State.html
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.etree import ElementTree

import numpy as np

from regents_cosim.norms.limits import STANDING_M_S
from regents_cosim.scenario import VEHICLE_KINDS, Agent, Scenario


@dataclass(frozen=True)
class DriverParameters:
    """Parameters of a SUMO driver; the defaults are those of its passenger car."""

    attributes: Mapping[str, float] = field(default_factory=dict)  # of a vType; SUMO ignores unknown ones
    speed_mode: int = 31  # all checks
    lane_change_mode: int = 1621  # all reasons for lane changes, into sufficient gaps


SUMO_DRIVER = DriverParameters()


def background_drivers(scenario: Scenario) -> dict[int, DriverParameters]:
    """The vehicles that SUMO drives, by index: all but the ego, the adversary and those that never move.

    A vehicle may stand during the whole log because of something outside the scene: a queue further on, or others with
    right of way. SUMO would start it.
    """
    tracks = scenario.tracks
    moves = tracks.valid & (tracks.speed > STANDING_M_S)
    stands = np.array([there.any() and not moved.any() for there, moved in zip(tracks.valid, moves, strict=True)])
    return {
        index: SUMO_DRIVER
        for index, agent in enumerate(scenario.agents)
        if index > 0 and agent.role != "adversary" and agent.kind in VEHICLE_KINDS and not stands[index]
    }


def type_file(agents: tuple[Agent, ...], drivers: Mapping[int, DriverParameters]) -> bytes:
    """An additional file with a vType for each agent that has a driver."""
    root = ElementTree.Element("additional")
    for index, driver in drivers.items():
        size = {"length": agents[index].length, "width": agents[index].width}
        values = {name: repr(float(value)) for name, value in (size | dict(driver.attributes)).items()}
        ElementTree.SubElement(root, "vType", {"id": driven_type(index), **values})
    return ElementTree.tostring(root)


def driven_type(index: int) -> str:
    """The name of the vType of a driven agent."""
    return f"driven{index}"
