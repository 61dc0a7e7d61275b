"""Turns a SUMO network into a RoadMap: the lanes for cars, their connections, the drivable area.

Lanes closed to passenger cars (footpaths, tracks, bus lanes) and crossings are left out. Bicycle lanes are not lanes of
the map either, but belong to the drivable area. Paths through junctions are lanes of their own, and may be chains of
several. Neighbours are lanes that a passenger car may change to, by `changeLeft` and `changeRight` of a lane.
"""

import gzip
import itertools
import xml.sax
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple
from xml.sax.xmlreader import AttributesImpl

import numpy as np
import shapely
import sumolib
from shapely.errors import ShapelyError
from shapely.geometry.base import BaseGeometry

from regents_cosim.checks.work import STEPS, Work
from regents_cosim.checks.xml_input import ElementCount, explained_xml, open_xml
from regents_cosim.errors import InputError, ScenarioError, SumoError, require
from regents_cosim.geometry.areas import closed, require_few_crossings
from regents_cosim.maps.net_elements import require_network_alone
from regents_cosim.maps.roadmap import Connection, Lane, RoadMap

_FARTHEST_M = 1e8  # from the origin; maps in UTM lie up to 1e7 m from it
_CLOSE_M = 0.2  # gaps between lanes up to twice as wide belong to the road
_LEAST_LENGTH_M = 1e-3  # netconvert writes lanes of a single point as two equal points, without a direction


def read_road_map(path: Path) -> RoadMap:
    """Read a .net.xml or .net.xml.gz.

    Raises SumoError where the file is damaged, is no network, or has no lane for cars.
    """
    with open_xml(path, "SUMO network", SumoError) as stream, explained_xml(path, "a SUMO network", SumoError):
        content = stream.read()
    with _explained(path), np.errstate(all="ignore"):
        return _road_map(*_parse(content, path), content, path.stat().st_size)


@contextmanager
def _explained(path: Path) -> Iterator[None]:
    """Turn any exception that a damaged network causes into one SumoError."""
    try:
        yield
    except (SumoError, InputError) as error:
        raise SumoError(f"{path}: {error}") from error
    except xml.sax.SAXParseException as error:
        where = f"at line {error.getLineNumber()} ({error.getMessage()})"
        raise SumoError(f"{path}: broken XML {where}; expected a SUMO network") from error
    except (
        ValueError, KeyError, IndexError, TypeError, AttributeError, ArithmeticError, ShapelyError, RecursionError,
        ScenarioError,
    ) as error:  # fmt: skip
        raise SumoError(f"{path}: damaged SUMO network ({type(error).__name__}: {error})") from error


def _road_map(net: sumolib.net.Net, rules: "_Rules", content: bytes, packed_bytes: int) -> RoadMap:
    require_network_alone(content, packed_bytes)
    lanes = {lane.getID(): lane for lane in _car_lanes(net)}
    if not lanes:
        raise SumoError(
            "no lane of this network allows passenger cars (expected at least one; see allow/disallow of its lanes)"
        )
    work = Work(packed_bytes)
    links = (link for lane in lanes.values() for link in _connections(lane, net, lanes, work))
    return RoadMap(
        lanes=tuple(_lane(lane, lanes, rules) for lane in lanes.values()),
        connections=tuple(dict.fromkeys(links)),
        drivable=_drivable(net, list(lanes.values())),
        sumo_net=gzip.compress(content, mtime=0),  # without a time stamp, so that equal networks give equal bytes
    )


class _Rules(NamedTuple):
    """The facts that sumolib does not read: the side of traffic, where a car may not change lanes, limits for cars."""

    lefthand: bool
    solid: frozenset[tuple[str, str]]  # lane id and `changeLeft` or `changeRight`, seen along the lane
    limits: dict[str, float]  # [m/s] for passenger cars by type of road, which replace those of its lanes


class _Reader(sumolib.net.NetReader):
    """sumolib's reader, which also reads `_Rules`; `lefthand` is None for a file that is not a network."""

    lefthand: bool | None = None

    def __init__(self, count: ElementCount) -> None:
        super().__init__(withInternal=True)
        self._count = count
        self.solid: set[tuple[str, str]] = set()
        self.limits: dict[str, float] = {}
        self._type = ""

    def startElement(self, name: str, attrs: AttributesImpl) -> None:  # noqa: N802
        self._count.open()
        if name == "net":
            self.lefthand = attrs.get("lefthand") == "true"
        if name == "type":
            self._type = attrs.get("id", "")
        if name == "restriction" and attrs.get("vClass") == "passenger":
            self.limits[self._type] = float(attrs["speed"])
        if name == "lane":
            for side in ("changeLeft", "changeRight"):
                if {"all", "passenger"}.isdisjoint(attrs.get(side, "all").split()):
                    self.solid.add((attrs.get("id", ""), side))
        super().startElement(name, attrs)

    def endElement(self, name: str) -> None:  # noqa: N802
        self._count.close()
        super().endElement(name)


def _parse(content: bytes, path: Path) -> tuple[sumolib.net.Net, _Rules]:
    reader = _Reader(ElementCount(path.stat().st_size))
    xml.sax.parseString(content, reader)
    if reader.lefthand is None:
        raise SumoError("not a SUMO network (expected the root element <net>, as netconvert writes it)")
    return reader.getNet(), _Rules(reader.lefthand, frozenset(reader.solid), reader.limits)


# --- lanes ------------------------------------------------------------------------------------


def _car_lanes(net: sumolib.net.Net) -> Iterator[sumolib.net.lane.Lane]:
    for edge in net.getEdges(withInternal=True):
        if edge.getFunction() in ("", "internal"):
            yield from (lane for lane in edge.getLanes() if lane.allows("passenger") and _has_direction(lane))


def _has_direction(lane: sumolib.net.lane.Lane) -> bool:
    shape = np.array(lane.getShape())
    require(bool((np.abs(shape) < _FARTHEST_M).all()), f"lane {lane.getID()} lies beyond {_FARTHEST_M:g} m", SumoError)
    return shapely.LineString(shape).length > _LEAST_LENGTH_M


def _lane(lane: sumolib.net.lane.Lane, lanes: dict[str, sumolib.net.lane.Lane], rules: _Rules) -> Lane:
    left = -1 if rules.lefthand else 1  # lane 0 is the outermost
    shape, kind = np.array(lane.getShape3D()), lane.getEdge().getType()
    return Lane(
        id=lane.getID(),
        centre=shape[:, :2],
        height=shape[:, 2],
        width=lane.getWidth(),
        speed_limit=rules.limits[kind] if kind in rules.limits else lane.getSpeed(),
        junction=lane.getEdge().getFunction() == "internal",
        left=None if (lane.getID(), "changeLeft") in rules.solid else _neighbour(lane, left, lanes),
        right=None if (lane.getID(), "changeRight") in rules.solid else _neighbour(lane, -left, lanes),
    )


def _neighbour(lane: sumolib.net.lane.Lane, offset: int, lanes: dict[str, sumolib.net.lane.Lane]) -> str | None:
    edge = lane.getEdge()
    index = lane.getIndex() + offset
    if edge.getFunction() or not 0 <= index < edge.getLaneNumber():
        return None
    name = edge.getLane(index).getID()
    return name if name in lanes else None


# --- connections ------------------------------------------------------------------------------


def _connections(
    lane: sumolib.net.lane.Lane, net: sumolib.net.Net, lanes: dict[str, sumolib.net.lane.Lane], work: Work
) -> Iterator[Connection]:
    """The connections out of `lane`: those through a junction lane by lane, with the light at its entry."""
    if lane.getEdge().getFunction() == "internal":
        return
    for link in lane.getOutgoing():
        chain = [lane, *_ways_through(link, net), link.getToLane()]
        work.spend("lanes of one more way through a junction x steps", len(chain), 4 * STEPS)
        if not all(part.allows("passenger") for part in chain) or not _has_direction(link.getToLane()):
            continue
        names = [part.getID() for part in chain if part.getID() in lanes]
        signal = link.getTLSID() or None
        yield Connection(names[0], names[1], signal, max(link.getTLLinkIndex(), 0) if signal else 0)
        yield from (Connection(a, b) for a, b in itertools.pairwise(names[1:]))


def _ways_through(link: sumolib.net.connection.Connection, net: sumolib.net.Net) -> Iterator[sumolib.net.lane.Lane]:
    """The chain of internal lanes of `link`: a left turn often has two."""
    via, passed = link.getViaLaneID(), set()
    while via:
        if via in passed:
            raise SumoError(f"the way through a junction over lane {via} leads back to itself")
        passed.add(via)
        lane = net.getLane(via)
        yield lane
        following = lane.getOutgoing()
        via = following[0].getViaLaneID() if following else None


# --- drivable area ----------------------------------------------------------------------------


def _drivable(net: sumolib.net.Net, lanes: list[sumolib.net.lane.Lane]) -> BaseGeometry:
    """The union of lanes, of their roads' bicycle lanes and of junctions, with gaps up to 0.4 m closed."""
    on_wheels = [*lanes, *_bicycle_lanes(lanes)]
    centre_lines, outlines = [shapely.LineString(lane.getShape()) for lane in on_wheels], list(_junctions(net, lanes))
    require_few_crossings([*centre_lines, *outlines])
    half_widths = [0.5 * lane.getWidth() for lane in on_wheels]
    strips = shapely.buffer(centre_lines, half_widths, cap_style="flat")
    parts = [*strips, *(outline.buffer(0.0) for outline in outlines)]
    require_few_crossings(parts)
    return closed(shapely.union_all(parts), _CLOSE_M)


def _bicycle_lanes(lanes: list[sumolib.net.lane.Lane]) -> Iterator[sumolib.net.lane.Lane]:
    """Bicycle lanes, except footpaths, beside lanes for cars: a cyclist there is on the road."""
    for edge in dict.fromkeys(lane.getEdge() for lane in lanes):
        for lane in edge.getLanes():
            rides = lane.allows("bicycle") and not lane.allows("passenger") and not lane.allows("pedestrian")
            if rides and _has_direction(lane):
                yield lane


def _junctions(net: sumolib.net.Net, lanes: list[sumolib.net.lane.Lane]) -> Iterator[shapely.Polygon]:
    edges = {lane.getEdge() for lane in lanes}
    nodes = dict.fromkeys(node.getID() for edge in edges for node in (edge.getFromNode(), edge.getToNode()))
    for name in sorted(nodes):
        shape = net.getNode(name).getShape()
        if len(shape) >= 3:
            yield shapely.Polygon(shape)
