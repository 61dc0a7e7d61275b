"""Writes CommonRoad XML 2020a: lanelets including sidewalks and crosswalks, obstacles, and the ego's planning problem.

There are two files for two uses: `planning.xml` has all but the ego, whose start and target form the planning problem;
`recorded.xml` has the ego among the obstacles and no problem. CommonRoad identifies lanelets, lights and obstacles by
numbers; `ids.csv` lists what they stand for. Lights follow the case, and repeat after it, since the format has cycles.

Source of the format: CommonRoad 2020a, "Documentation of the XML format".
"""

import csv
import itertools
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from jaxtyping import Float

from regents_cosim.exports.commonroad_map import NumberedMap, document, number_text, points
from regents_cosim.exports.lights import without_place
from regents_cosim.exports.stays import Presence, poses, stays
from regents_cosim.scenario.scenario import Kind, Scenario

_TYPES: dict[Kind, str] = {
    "car": "car", "truck": "truck", "bus": "bus", "motorcycle": "motorcycle", "bicycle": "bicycle",
    "pedestrian": "pedestrian", "other": "unknown",
}  # fmt: skip
_GOAL_M = (6.0, 3.0)  # length and width of the goal region


def write_commonroad(scenario: Scenario, folder: Path) -> list[str]:
    """Write `planning.xml`, `recorded.xml` and `ids.csv` into `folder`; returns what is left out, as messages."""
    numbers = itertools.count(1)
    mapped = NumberedMap(scenario.road, scenario.signals, scenario.tracks.steps, numbers)
    others = [(str(next(numbers)), stay) for stay in stays(scenario)]
    left_out = without_place(scenario, ((one.signal, link) for _, one in mapped.lights for link in one.links))
    recorded, planning = (
        document(scenario.id, scenario.dt, "; ".join([f"regents_cosim, case {scenario.id}, {use}", *left_out]))
        for use in ("recorded", "planning")
    )
    road = list(mapped.elements())
    for root in (recorded, planning):
        root.extend(road)
    for number, stay in others:
        recorded.append(_obstacle(scenario, number, stay))
        if stay.index:
            planning.append(_obstacle(scenario, number, stay))
    planning.append(_problem(scenario, str(next(numbers))))
    for name, root in {"recorded": recorded, "planning": planning}.items():
        ET.indent(root)
        (folder / f"{name}.xml").write_bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n")
    rows = [("lanelet", number, name, "") for name, number in (mapped.lanes | mapped.walkways).items()]
    rows += [("piece", number, "", "") for number, _ in mapped.pieces]
    rows += [("light", number, f"{one.signal} {' '.join(map(str, one.links))}", "") for number, one in mapped.lights]
    rows += [("obstacle", number, stay.agent.id, stay.agent.role) for number, stay in others]
    with (folder / "ids.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([("what", "number", "id", "role"), *rows])
    return left_out


# --- traffic ----------------------------------------------------------------------------------


def _obstacle(scenario: Scenario, number: str, stay: Presence) -> ET.Element:
    element = ET.Element("dynamicObstacle", id=number)
    ET.SubElement(element, "type").text = _TYPES[stay.agent.kind]
    rectangle = ET.SubElement(ET.SubElement(element, "shape"), "rectangle")
    for name, size in {"length": stay.agent.length, "width": stay.agent.width}.items():
        ET.SubElement(rectangle, name).text = number_text(size)
    first, *rest = poses(scenario, stay)
    _state(ET.SubElement(element, "initialState"), stay.first, first)
    trajectory = ET.SubElement(element, "trajectory")  # for a single instant its only state
    for step, pose in enumerate(rest or [first], start=stay.first + bool(rest)):
        _state(ET.SubElement(trajectory, "state"), step, pose)
    return element


def _state(state: ET.Element, step: int, pose: Float[np.ndarray, " 4"]) -> None:
    x, y, yaw, speed = pose.tolist()
    points(ET.SubElement(state, "position"), [(x, y)])
    _exact(state, "orientation", number_text(yaw))
    _exact(state, "time", str(step))
    _exact(state, "velocity", number_text(speed))


def _exact(parent: ET.Element, name: str, value: str) -> None:
    ET.SubElement(ET.SubElement(parent, name), "exact").text = value


# --- the ego ----------------------------------------------------------------------------------


def _problem(scenario: Scenario, number: str) -> ET.Element:
    """The planning problem: from the ego's state at step 0 to around its target, by the end of the case."""
    problem = ET.Element("planningProblem", id=number)
    initial = ET.SubElement(problem, "initialState")
    ego = next(stays(scenario))
    _state(initial, 0, poses(scenario, ego)[0])
    for name in ("yawRate", "slipAngle"):
        _exact(initial, name, "0.0")
    goal = ET.SubElement(problem, "goalState")
    place = ET.SubElement(ET.SubElement(goal, "position"), "rectangle")
    yaw = float(scenario.tracks.yaw[0, -1])
    for name, value in zip(("length", "width", "orientation"), (*_GOAL_M, yaw), strict=True):
        ET.SubElement(place, name).text = number_text(value)
    centre = ET.SubElement(place, "center")
    for name, value in zip(("x", "y"), scenario.target, strict=True):
        ET.SubElement(centre, name).text = number_text(value)
    time = ET.SubElement(goal, "time")
    ET.SubElement(time, "intervalStart").text = "1"
    ET.SubElement(time, "intervalEnd").text = str(scenario.tracks.steps - 1)
    return problem
