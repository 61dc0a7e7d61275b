"""How an agent looks to SUMO, and what it is called there."""

import re
from collections.abc import Collection
from types import ModuleType

from regents_cosim.planners.interface import AgentState
from regents_cosim.scenario import Agent

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
    """A type of vehicle, or of person, of the size and looks of `agent`."""
    kinds = sumo.vehicletype
    kinds.copy("DEFAULT_PEDTYPE" if is_person else "DEFAULT_VEHTYPE", name)
    kinds.setLength(name, agent.length)
    kinds.setWidth(name, agent.width)
    kinds.setShapeClass(name, _SHAPES[agent.kind])
    if is_person:
        kinds.setVehicleClass(name, "ignoring")  # a pedestrian departs only from an edge with room for pedestrians


def type_name(index: int) -> str:
    """The type of the agent with that index."""
    return f"agent{index}"


def free_name(agent_id: str, taken: Collection[str]) -> str:
    """A name that SUMO takes and that none had before: logs hold blanks, bars, any character."""
    plain = re.sub(r"[^A-Za-z0-9_.-]", "_", agent_id) or "_"
    name, number = plain, 1
    while name in taken:
        number += 1
        name = f"{plain}#{number}"
    return name
