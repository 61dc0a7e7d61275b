"""Writes a road as CommonRoad's lanelets, with speed limits, stop lines and traffic lights.

Source of the format: CommonRoad 2020a, "Documentation of the XML format".
"""

import datetime
import itertools
import tempfile
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from regents_cosim.errors import MissingDependencyError, install_hint
from regents_cosim.exports.lights import Light, lights_of
from regents_cosim.maps.lanelets import Bounds, pieces_between, ribbon, ribbons
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.maps.walkways import WalkwayKind
from regents_cosim.scenario.scenario import Signal

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork  # pyright: ignore[reportMissingImports]

_WALKED: dict[WalkwayKind, str] = {"sidewalk": "sidewalk", "crossing": "crosswalk"}  # the areas between have no sides
_COLOURS = {"r": "red", "s": "red", "u": "redYellow", "y": "yellow", "Y": "yellow", "g": "green", "G": "green"}
_DIRECTIONS: dict[frozenset[str], str] = {
    frozenset({"left"}): "left", frozenset({"straight"}): "straight", frozenset({"right"}): "right",
    frozenset({"left", "straight"}): "leftStraight", frozenset({"straight", "right"}): "straightRight",
    frozenset({"left", "right"}): "leftRight",
}  # fmt: skip
_SPEED_LIMIT = "274"  # the sign's number in Germany and in CommonRoad's Zamunda


class NumberedMap:
    """A road with the numbers by which CommonRoad knows its parts."""

    def __init__(self, road: RoadMap, signals: Sequence[Signal], steps: int, numbers: Iterator[int]) -> None:
        """Number the lanes first, in their order from the first of `numbers` on."""
        self._road = road
        self.lanes = {lane.id: str(next(numbers)) for lane in road.lanes}  # by id
        self.walkways = {one.id: str(next(numbers)) for one in road.walkways if one.kind in _WALKED}
        places = self.lanes.keys() | self.walkways.keys()
        known = (light for light in lights_of(road, signals, steps) if light.at in places)
        self.lights = [(str(next(numbers)), light) for light in known]
        self._lights_at: dict[str, list[str]] = {}  # numbers, by the lane or crossing at whose end they stand
        for number, light in self.lights:
            self._lights_at.setdefault(light.at, []).append(number)
        self.pieces = [(str(next(numbers)), piece) for piece in pieces_between(road)]  # of road between the lanes
        limits = sorted({lane.speed_limit for lane in road.lanes if np.isfinite(lane.speed_limit)})
        self._limits = {limit: str(next(numbers)) for limit in limits}  # numbers of signs by speed limit [m/s]

    def elements(self) -> Iterator[ET.Element]:
        """Lanelets, signs and lights, in the order of the format."""
        yield from self._lanes()
        for one in self._road.walkways:
            if one.id in self.walkways:
                element = _lanelet(self.walkways[one.id], ribbon(one.shape, one.width))
                self._typed(element, _WALKED[one.kind], one.id)
                yield element
        for number, piece in self.pieces:
            element = _lanelet(number, piece)
            ET.SubElement(element, "laneletType").text = "border"
            yield element
        first = {lane.speed_limit: lane for lane in reversed(self._road.lanes)}
        for limit, number in self._limits.items():
            yield _limit(number, limit, first[limit].centre[0])
        for number, light in self.lights:
            yield _light(number, light)

    def _lanes(self) -> Iterator[ET.Element]:
        sides = ribbons(self._road)
        for lane in self._road.lanes:
            element = _lanelet(self.lanes[lane.id], sides[lane.id])
            before = [self.lanes[link.source] for link in self._road.entries[lane.id]]
            after = [self.lanes[link.target] for link in self._road.exits[lane.id]]
            for name, others in {"predecessor": before, "successor": after}.items():
                for other in dict.fromkeys(others):
                    ET.SubElement(element, name, ref=other)
            for name, other in {"adjacentLeft": lane.left, "adjacentRight": lane.right}.items():
                if other in self.lanes:
                    ET.SubElement(element, name, ref=self.lanes[other], drivingDir="same")
            if lights := self._lights_at.get(lane.id):
                _stop_line(element, sides[lane.id], lights)
            kind = "intersection" if lane.junction else "urban"
            self._typed(element, kind, lane.id, self._limits.get(lane.speed_limit))
            yield element

    def _typed(self, lanelet: ET.Element, kind: str, place: str, sign: str | None = None) -> None:
        """Add the last elements of a lanelet: its type, its sign and its lights."""
        ET.SubElement(lanelet, "laneletType").text = kind
        if sign is not None:
            ET.SubElement(lanelet, "trafficSignRef", ref=sign)
        for number in self._lights_at.get(place, ()):
            ET.SubElement(lanelet, "trafficLightRef", ref=number)


def lanelet_network(road: RoadMap, signals: Sequence[Signal], steps: int) -> "LaneletNetwork":
    """The road as an object of commonroad-io, in which lanelet k is `road.lanes[k - 1]`; see `Scene.commonroad`."""
    try:
        with warnings.catch_warnings(action="ignore"):  # of the protobuf that it pins
            from commonroad.common.file_reader import CommonRoadFileReader  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise MissingDependencyError(
            f"a map for CommonRoad's planners needs commonroad-io: {install_hint('planners-commonroad')}"
        ) from error
    root = document("map", 0.1, "")
    root.extend(NumberedMap(road, signals, steps, itertools.count(1)).elements())
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "map.xml"
        ET.ElementTree(root).write(file, encoding="utf-8", xml_declaration=True)
        return CommonRoadFileReader(str(file)).open_lanelet_network()


def document(name: str, dt: float, source: str) -> ET.Element:
    """The root element with its header, for steps of `dt` [s]."""
    letters = "".join(c for c in name if c.isascii() and c.isalnum())  # a benchmark's id allows no others
    root = ET.Element(
        "commonRoad",
        commonRoadVersion="2020a",
        benchmarkID=f"ZAM_{letters or 'case'}-1_1_T-1",
        date=datetime.date.today().isoformat(),
        author="",
        affiliation="",
        source=source,
        timeStepSize=repr(dt),
    )
    location = ET.SubElement(root, "location")
    for name, value in {"geoNameId": "-999", "gpsLatitude": "999", "gpsLongitude": "999"}.items():
        ET.SubElement(location, name).text = value
    ET.SubElement(ET.SubElement(root, "scenarioTags"), "simulated")
    return root


def _lanelet(number: str, sides: Bounds) -> ET.Element:
    element = ET.Element("lanelet", id=number)
    for name, side in zip(("leftBound", "rightBound"), sides, strict=True):
        points(ET.SubElement(element, name), side)
    return element


def _stop_line(lanelet: ET.Element, sides: Bounds, lights: list[str]) -> None:
    """Add the line across the end of a lanelet, for its lights."""
    line = ET.SubElement(lanelet, "stopLine")
    points(line, [sides.left[-1], sides.right[-1]])
    ET.SubElement(line, "lineMarking").text = "solid"
    for number in lights:
        ET.SubElement(line, "trafficLightRef", ref=number)


def _limit(number: str, limit: float, place: Float[np.ndarray, "2"]) -> ET.Element:
    """A speed limit [m/s] of several lanelets, at the place [m] where the first of them begins."""
    sign = ET.Element("trafficSign", id=number)
    element = ET.SubElement(sign, "trafficSignElement")
    ET.SubElement(element, "trafficSignID").text = _SPEED_LIMIT
    ET.SubElement(element, "additionalValue").text = number_text(limit)
    points(ET.SubElement(sign, "position"), [place])
    ET.SubElement(sign, "virtual").text = "true"
    return sign


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


def points(parent: ET.Element, places: Iterable[Iterable[float]]) -> None:
    """Add points [m] to an element."""
    for point in places:
        place = ET.SubElement(parent, "point")
        for name, value in zip(("x", "y"), point, strict=True):
            ET.SubElement(place, name).text = number_text(value)


def number_text(value: float) -> str:
    """A number with nine places."""
    return f"{value:.9f}"
