"""lanelet2 maps (.osm): lanelets for vehicles, their successors and neighbours, and crosswalks.

Nodes are in latitude and longitude. INTERACTION's lie near (0, 0) and stand for metres in UTM zone 31 less its origin
there; a map of a real place needs the UTM origin that its tracks refer to. Coordinates in metres (`.osm_xy`, nodes with
x and y, or tags `local_x` and `local_y`) are used as they are.
"""

import xml.etree.ElementTree as ET
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from regents_cosim.checks.work import STEPS, Work
from regents_cosim.errors import LogError
from regents_cosim.geometry.frames import from_lat_lon
from regents_cosim.maps.roadmap import Approach
from regents_cosim.norms.limits import ASSUMED_LIMIT_M_S
from regents_cosim.sources.logs.files.xml_files import read_xml
from regents_cosim.sources.logs.formats import explained
from regents_cosim.sources.logs.roads.road import KMH, centre_line, lanelet, may_cross_way, run_alike, speed_of
from regents_cosim.sources.logs.scene import LoggedLane, LoggedMap, with_openings

_NOT_FOR_CARS = {"walkway", "stairs", "shared_walkway", "bicycle_lane", "sidewalk", "exit"}
_ZONE_OF_ORIGIN = 31  # (0, 0) lies in it


class UtmOrigin(NamedTuple):
    """The origin that is subtracted from UTM coordinates."""

    zone: int
    x: float  # [m]
    y: float  # [m]


class _Lanelet(NamedTuple):
    id: str
    ways: tuple[str, str]  # ids of left and right bound
    left: tuple[str, ...]  # node ids in the direction of travel
    right: tuple[str, ...]
    tags: dict[str, str]
    as_drawn: tuple[bool, bool]  # whether the left and the right bound run in the order of their nodes in the file


def read_lanelet2(path: Path, origin: UtmOrigin | None = None) -> LoggedMap:
    """Read a map. Raises LogError where the file is damaged or has no lanelet for vehicles."""
    with explained(path, "lanelet2 map"):
        return _map(path, read_xml(path, "osm", "osm_xy"), origin)


def _map(path: Path, root: ET.Element, origin: UtmOrigin | None) -> LoggedMap:
    root[:] = [element for element in root if element.get("action") != "delete"]  # JOSM keeps what was deleted
    place = _nodes(root, origin)
    ways = {way.get("id", ""): tuple(nd.get("ref", "") for nd in way.findall("nd")) for way in root.findall("way")}
    lines = {way.get("id", ""): _tags_of(way) for way in root.findall("way")}
    limits, signs = _speed_limits(root), _approaches(root)
    work = Work.of(path)
    found = [one for relation in root.findall("relation") if (one := _lanelet(relation, ways, place, work)) is not None]
    neighbours = _Neighbours([one for one in found if not _is_crosswalk(one.tags)], lines)
    lanes, areas, crossings = [], [], []
    for one in found:
        left, right = (np.array([place[node] for node in side]) for side in (one.left, one.right))
        area = lanelet(left, right)
        if area is not None and _is_crosswalk(one.tags):
            crossings.append(area)
        elif area is not None:
            areas.append(area)
            lanes.append(_lane(one, neighbours, left, right, limits, signs))
            work.spend("lanelets that one leads to", len(lanes[-1].exits))
    if not lanes:
        raise LogError(f"{path}: no lanelet for vehicles (expected a lanelet2 map)")
    return LoggedMap(with_openings(tuple(lanes)), (), tuple(areas), tuple(crossings) or None)


def _nodes(root: ET.Element, origin: UtmOrigin | None) -> dict[str, tuple[float, float]]:
    nodes = root.findall("node")
    names = [node.get("id", "") for node in nodes]
    for first, second, values_of in (("x", "y", lambda node: node.attrib), ("local_x", "local_y", _tags_of)):
        if nodes and {first, second} <= values_of(nodes[0]).keys():
            return {name: _place(values_of(node), first, second) for name, node in zip(names, nodes, strict=True)}
    degrees = np.array([_place(node.attrib, "lat", "lon") for node in nodes], float).reshape(-1, 2)
    if len(degrees) and (np.abs(degrees) > [90.0, 180.0]).any():
        raise ValueError("a latitude or longitude is out of range")
    at = origin or UtmOrigin(_ZONE_OF_ORIGIN, *(float(v) for v in from_lat_lon(0.0, 0.0, _ZONE_OF_ORIGIN)))
    x, y = from_lat_lon(degrees[:, 0], degrees[:, 1], at.zone)
    if origin is None and len(degrees) and np.abs(degrees).max() > 1.0:
        raise ValueError("the map is of a real place, not around (0, 0); its UTM origin is not known")
    metres = np.column_stack([x - at.x, y - at.y]).tolist()
    return {name: (east, north) for name, (east, north) in zip(names, metres, strict=True)}


def _place(values: dict[str, str], first: str, second: str) -> tuple[float, float]:
    place = float(values.get(first, "nan")), float(values.get(second, "nan"))
    if not np.isfinite(place).all():
        raise ValueError("a node has no place")
    return place


def _tags_of(element: ET.Element) -> dict[str, str]:
    return {tag.get("k", ""): tag.get("v", "") for tag in element.findall("tag")}


def _is_crosswalk(tags: dict[str, str]) -> bool:
    return tags.get("subtype") == "crosswalk"


def _lanelet(
    relation: ET.Element, ways: dict[str, tuple[str, ...]], place: dict[str, tuple[float, float]], work: Work
) -> _Lanelet | None:
    tags = _tags_of(relation)
    if tags.get("type") != "lanelet" or tags.get("subtype") in _NOT_FOR_CARS:
        return None
    if tags.get("participant:vehicle") == "no" and not _is_crosswalk(tags):
        return None
    refs = {member.get("role"): member.get("ref", "") for member in relation.findall("member")}
    if "left" not in refs or "right" not in refs:
        return None
    left, right = ways[refs["left"]], ways[refs["right"]]
    if len(left) < 2 or len(right) < 2:
        return None
    work.spend("nodes of the bounds of one more lanelet x steps", len(left) + len(right), STEPS)
    driven = _in_driving_direction(left, right, place)
    as_drawn = driven[0] == left, driven[1] == right
    return _Lanelet(relation.get("id", ""), (refs["left"], refs["right"]), *driven, tags, as_drawn)


def _in_driving_direction(
    left: tuple[str, ...], right: tuple[str, ...], place: dict[str, tuple[float, float]]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The two bounds in the same direction, the left one on the left."""
    a, b = (np.array([place[node] for node in side]) for side in (left, right))
    if not run_alike(a, b):
        right, b = right[::-1], b[::-1]
    ring = np.concatenate([a, b[::-1]])
    turns_left = (ring[:, 0] * np.roll(ring[:, 1], -1) - ring[:, 1] * np.roll(ring[:, 0], -1)).sum() > 0
    return (left[::-1], right[::-1]) if turns_left else (left, right)


class _Neighbours:
    """The successors of lanelets, and those that share a bound with them."""

    def __init__(self, every: list[_Lanelet], lines: dict[str, dict[str, str]]) -> None:
        self._lines = lines
        self._from: dict[tuple[str, str], list[str]] = {}
        self._left: dict[tuple[str, str], str] = {}
        self._right: dict[tuple[str, str], str] = {}
        for one in every:
            self._from.setdefault((one.left[0], one.right[0]), []).append(one.id)
            self._left.setdefault((one.ways[0], one.left[0]), one.id)
            self._right.setdefault((one.ways[1], one.right[0]), one.id)

    def after(self, one: _Lanelet) -> tuple[str, ...]:
        """The lanelets that begin where this one ends."""
        return tuple(self._from.get((one.left[-1], one.right[-1]), ()))

    def left_of(self, one: _Lanelet) -> str | None:
        """The lanelet on the left that runs the same way, if one may change to it; else None."""
        beside = self._right.get((one.ways[0], one.left[0]))
        return beside if may_cross_way(self._lines.get(one.ways[0], {}), one.as_drawn[0]) else None

    def right_of(self, one: _Lanelet) -> str | None:
        """The lanelet on the right that runs the same way, if one may change to it; else None."""
        beside = self._left.get((one.ways[1], one.right[0]))
        return beside if may_cross_way(self._lines.get(one.ways[1], {}), not one.as_drawn[1]) else None


def _lane(
    one: _Lanelet, neighbours: _Neighbours, left: Float[np.ndarray, "a 2"], right: Float[np.ndarray, "b 2"],
    limits: dict[str, float], signs: dict[str, Approach],
) -> LoggedLane:  # fmt: skip
    centre, width = centre_line(left, right)
    return LoggedLane(
        id=one.id,
        centre=centre,
        width=width,
        speed_limit=limits.get(one.id, ASSUMED_LIMIT_M_S),
        exits=neighbours.after(one),
        left=neighbours.left_of(one),
        right=neighbours.right_of(one),
        approach=signs.get(one.id),
    )


# By subtype of a regulatory element and role of its member. Source: lanelet2's documentation, RegulatoryElementTagging.
_APPROACHES: dict[tuple[str, str], Approach] = {
    ("right_of_way", "right_of_way"): "priority",
    ("right_of_way", "yield"): "yields",
    ("all_way_stop", "yield"): "stops",
}


def _approaches(root: ET.Element) -> dict[str, Approach]:
    """What regulatory elements tell on giving way, by lanelet.

    A lanelet of which they tell two things is left out, and so is one with a light, whose states the map does not hold.
    """
    found: dict[str, set[Approach]] = {}
    relations = {relation.get("id", ""): relation for relation in root.findall("relation")}
    kinds = {name: _tags_of(relation).get("subtype", "") for name, relation in relations.items()}
    for name, relation in relations.items():
        for member in relation.findall("member"):
            told = _APPROACHES.get((kinds[name], member.get("role", "")))
            if told:
                found.setdefault(member.get("ref", ""), set()).add(told)
            elif kinds.get(member.get("ref", "")) == "traffic_light":
                found.setdefault(name, set()).update(("priority", "yields"))
    return {name: next(iter(told)) for name, told in found.items() if len(told) == 1}


def _speed_limits(root: ET.Element) -> dict[str, float]:
    """The speed limit [m/s] of every lanelet that refers to one, by id."""
    signs = {}
    for relation in root.findall("relation"):
        tags = _tags_of(relation)
        if tags.get("subtype") == "speed_limit":
            with suppress(ValueError):  # the name of a sign
                signs[relation.get("id")] = speed_of(tags.get("sign_type", ""), KMH)
    found = {}
    for relation in root.findall("relation"):
        for member in relation.findall("member"):
            limit = signs.get(member.get("ref"))
            if limit is not None and 0 < limit < 100:
                found[relation.get("id", "")] = limit
    return found
