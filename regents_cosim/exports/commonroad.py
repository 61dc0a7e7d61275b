"""Writes CommonRoad XML 2020a: lanelets including sidewalks and crosswalks, obstacles, and the ego's planning problem.

There are two files for two uses: `planning.xml` has all but the ego, whose start and target form the planning problem;
`recorded.xml` has the ego among the obstacles and no problem. CommonRoad identifies lanelets, lights and obstacles by
numbers; `ids.csv` lists what they stand for. Lights follow the case, and repeat after it, since the format has cycles.

Source of the format: CommonRoad 2020a, "Documentation of the XML format".
"""

import csv
import datetime
import itertools
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float

from regents_cosim.exports.lights import Light, lights_of, without_place
from regents_cosim.exports.stays import Presence, poses, stays
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.maps.walkways import WalkwayKind
from regents_cosim.scenario import Kind, Scenario

_TYPES: dict[Kind, str] = {
    "car": "car", "truck": "truck", "bus": "bus", "motorcycle": "motorcycle", "bicycle": "bicycle",
    "pedestrian": "pedestrian", "other": "unknown",
}  # fmt: skip
_WALKED: dict[WalkwayKind, str] = {"sidewalk": "sidewalk", "crossing": "crosswalk"}  # the areas between have no sides
_COLOURS = {"r": "red", "s": "red", "u": "redYellow", "y": "yellow", "Y": "yellow", "g": "green", "G": "green"}
_DIRECTIONS: dict[frozenset[str], str] = {
    frozenset({"left"}): "left", frozenset({"straight"}): "straight", frozenset({"right"}): "right",
    frozenset({"left", "straight"}): "leftStraight", frozenset({"straight", "right"}): "straightRight",
    frozenset({"left", "right"}): "leftRight",
}  # fmt: skip
_SHARPEST = 0.25  # cosine of half the bend, below which bounds are not mitred further
_GOAL_M = (6.0, 3.0)  # length and width of the goal region
_LEAST_STEP_M = 1e-3  # points closer than this give no direction


def write_commonroad(scenario: Scenario, folder: Path) -> list[str]:
    """Write `planning.xml`, `recorded.xml` and `ids.csv` into `folder`; returns what is left out, as messages."""
    numbers = itertools.count(1)
    lanes = {lane.id: str(next(numbers)) for lane in scenario.road.lanes}
    walkways = {one.id: str(next(numbers)) for one in scenario.road.walkways if one.kind in _WALKED}
    lights = [(str(next(numbers)), light) for light in lights_of(scenario) if light.at in lanes | walkways]
    others = [(str(next(numbers)), stay) for stay in stays(scenario)]
    left_out = without_place(scenario, ((one.signal, link) for _, one in lights for link in one.links))
    recorded, planning = (_document(scenario, "; ".join([use, *left_out])) for use in ("recorded", "planning"))
    stand_at = {name: [number for number, light in lights if light.at == name] for name in (*lanes, *walkways)}
    for root in (recorded, planning):
        root.extend([*_lanelets(scenario.road, lanes, stand_at), *_walkways(scenario.road, walkways, stand_at)])
        root.extend(_light(number, light) for number, light in lights)
    for number, stay in others:
        recorded.append(_obstacle(scenario, number, stay))
        if stay.index:
            planning.append(_obstacle(scenario, number, stay))
    planning.append(_problem(scenario, str(next(numbers))))
    for name, root in {"recorded": recorded, "planning": planning}.items():
        ET.indent(root)
        (folder / f"{name}.xml").write_bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n")
    rows = [("lanelet", number, name, "") for name, number in (lanes | walkways).items()]
    rows += [("light", number, f"{one.signal} {' '.join(map(str, one.links))}", "") for number, one in lights]
    rows += [("obstacle", number, stay.agent.id, stay.agent.role) for number, stay in others]
    with (folder / "ids.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([("what", "number", "id", "role"), *rows])
    return left_out


def _document(scenario: Scenario, use: str) -> ET.Element:
    """The root element with the header, which also lists what is left out for this `use`."""
    root = ET.Element(
        "commonRoad",
        commonRoadVersion="2020a",
        benchmarkID=f"ZAM_{_letters(scenario.id)}-1_1_T-1",
        date=datetime.date.today().isoformat(),
        author="",
        affiliation="",
        source=f"regents_cosim, case {scenario.id}, {use}",
        timeStepSize=repr(scenario.dt),
    )
    location = ET.SubElement(root, "location")
    for name, value in {"geoNameId": "-999", "gpsLatitude": "999", "gpsLongitude": "999"}.items():
        ET.SubElement(location, name).text = value
    ET.SubElement(ET.SubElement(root, "scenarioTags"), "simulated")
    return root


def _letters(name: str) -> str:
    """The letters and digits of a name; a benchmark's id allows no others."""
    return "".join(c for c in name if c.isascii() and c.isalnum()) or "case"


# --- lanelets ---------------------------------------------------------------------------------


def _lanelets(road: RoadMap, numbers: dict[str, str], lights: dict[str, list[str]]) -> Iterator[ET.Element]:
    before: dict[str, list[str]] = {name: [] for name in numbers}
    for link in road.connections:
        before[link.target].append(numbers[link.source])
    for lane in road.lanes:
        element = _lanelet(numbers[lane.id], lane.centre, lane.width)
        after = [numbers[link.target] for link in road.exits[lane.id]]
        for name, others in {"predecessor": before[lane.id], "successor": after}.items():
            for other in dict.fromkeys(others):
                ET.SubElement(element, name, ref=other)
        for name, other in {"adjacentLeft": lane.left, "adjacentRight": lane.right}.items():
            if other in numbers:
                ET.SubElement(element, name, ref=numbers[other], drivingDir="same")
        _typed(element, "intersection" if lane.junction else "urban", lights[lane.id])
        yield element


def _walkways(road: RoadMap, numbers: dict[str, str], lights: dict[str, list[str]]) -> Iterator[ET.Element]:
    for one in road.walkways:
        if one.id in numbers:
            element = _lanelet(numbers[one.id], one.shape, one.width)
            _typed(element, _WALKED[one.kind], lights[one.id])
            yield element


def _typed(lanelet: ET.Element, kind: str, lights: list[str]) -> None:
    """Add the last elements of a lanelet: its type, and the lights at its end."""
    ET.SubElement(lanelet, "laneletType").text = kind
    for number in lights:
        ET.SubElement(lanelet, "trafficLightRef", ref=number)


def _light(number: str, light: Light) -> ET.Element:
    element = ET.Element("trafficLight", id=number)
    cycle = ET.SubElement(element, "cycle")
    for steps, letter in light.phases:
        shown = ET.SubElement(cycle, "cycleElement")
        ET.SubElement(shown, "duration").text = str(steps)
        ET.SubElement(shown, "color").text = _COLOURS.get(letter, "inactive")
    ET.SubElement(cycle, "timeOffset").text = "0"
    ET.SubElement(element, "direction").text = _DIRECTIONS.get(light.ways, "all")
    ET.SubElement(element, "active").text = "true"
    return element


def _lanelet(number: str, centre: Float[np.ndarray, "point 2"], width: float) -> ET.Element:
    """A lanelet that has only its bounds."""
    element = ET.Element("lanelet", id=number)
    for side, bound in zip(("leftBound", "rightBound"), bounds(centre, width), strict=True):
        _points(ET.SubElement(element, side), bound)
    return element


def bounds(
    line: Float[np.ndarray, "point 2"], width: float
) -> tuple[Float[np.ndarray, "_ 2"], Float[np.ndarray, "_ 2"]]:
    """Left and right bound [m] of a lane: its centre line, moved by half the width to each side, mitred at bends."""
    steps = np.diff(line, axis=0)
    kept = np.hypot(*steps.T) > _LEAST_STEP_M
    centre = line[np.concatenate([[True], kept])] if kept.any() else line[[0, -1]]
    along = np.diff(centre, axis=0)
    along /= np.maximum(np.hypot(*along.T), 1e-12)[:, None]
    normal = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    both = np.concatenate([normal[:1], normal]) + np.concatenate([normal, normal[-1:]])
    length = np.hypot(*both.T)  # twice the cosine of half the bend
    across = both / np.maximum(length, 1e-12)[:, None] / np.maximum(0.5 * length, _SHARPEST)[:, None]
    return centre + 0.5 * width * across, centre - 0.5 * width * across


def _points(parent: ET.Element, points: Iterable[Iterable[float]]) -> None:
    for point in points:
        place = ET.SubElement(parent, "point")
        for name, value in zip(("x", "y"), point, strict=True):
            ET.SubElement(place, name).text = _number(value)


# --- traffic ----------------------------------------------------------------------------------


def _obstacle(scenario: Scenario, number: str, stay: Presence) -> ET.Element:
    element = ET.Element("dynamicObstacle", id=number)
    ET.SubElement(element, "type").text = _TYPES[stay.agent.kind]
    rectangle = ET.SubElement(ET.SubElement(element, "shape"), "rectangle")
    for name, size in {"length": stay.agent.length, "width": stay.agent.width}.items():
        ET.SubElement(rectangle, name).text = _number(size)
    first, *rest = poses(scenario, stay)
    _state(ET.SubElement(element, "initialState"), stay.first, first)
    trajectory = ET.SubElement(element, "trajectory")  # for a single instant its only state
    for step, pose in enumerate(rest or [first], start=stay.first + bool(rest)):
        _state(ET.SubElement(trajectory, "state"), step, pose)
    return element


def _state(state: ET.Element, step: int, pose: Float[np.ndarray, " 4"]) -> None:
    x, y, yaw, speed = pose.tolist()
    _points(ET.SubElement(state, "position"), [(x, y)])
    _exact(state, "orientation", _number(yaw))
    _exact(state, "time", str(step))
    _exact(state, "velocity", _number(speed))


def _exact(parent: ET.Element, name: str, value: str) -> None:
    ET.SubElement(ET.SubElement(parent, name), "exact").text = value


def _number(value: float) -> str:
    return f"{value:.9f}"


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
        ET.SubElement(place, name).text = _number(value)
    centre = ET.SubElement(place, "center")
    for name, value in zip(("x", "y"), scenario.target, strict=True):
        ET.SubElement(centre, name).text = _number(value)
    time = ET.SubElement(goal, "time")
    ET.SubElement(time, "intervalStart").text = "1"
    ET.SubElement(time, "intervalEnd").text = str(scenario.tracks.steps - 1)
    return problem
