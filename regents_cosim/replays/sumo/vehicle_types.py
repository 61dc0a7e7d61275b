"""The type, name and looks of an agent in SUMO."""

import re
from collections.abc import Collection
from types import ModuleType

from regents_cosim.planners.interface import AgentState
from regents_cosim.scenario.scenario import Agent

_SHAPES = {
    "car": "passenger/sedan",
    "truck": "truck",
    "bus": "bus",
    "motorcycle": "motorcycle",
    "bicycle": "bicycle",
    "pedestrian": "pedestrian",
    "other": "passenger",
}


def add_type(sumo: ModuleType, name: str, agent: Agent | AgentState, is_person: bool = False) -> None:
    """Add a type of vehicle, or of person, with the size and looks of `agent`."""
    kinds = sumo.vehicletype
    kinds.copy("DEFAULT_PEDTYPE" if is_person else "DEFAULT_VEHTYPE", name)
    kinds.setLength(name, agent.length)
    kinds.setWidth(name, agent.width)
    kinds.setShapeClass(name, _SHAPES[agent.kind])
    if is_person:
        kinds.setVehicleClass(name, "ignoring")  # class pedestrian could only depart from edges with sidewalks


def type_name(index: int) -> str:
    """The type of the agent with that index."""
    return f"agent{index}"


def free_name(agent_id: str, taken: Collection[str]) -> str:
    """A name that SUMO accepts and that is not taken: ids in logs may contain blanks, bars or any character."""
    plain = re.sub(r"[^A-Za-z0-9_.-]", "_", agent_id) or "_"
    name, number = plain, 1
    while name in taken:
        number += 1
        name = f"{plain}#{number}"
    return name
