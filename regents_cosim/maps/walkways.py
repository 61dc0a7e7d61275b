"""Places for pedestrians in a SUMO network: sidewalks, walking areas at junctions, and crossings.

They are read on demand from the network that a map keeps, so they are no fields of the map.

Source of the format: SUMO's documentation, "Pedestrians", "Network requirements".
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.maps.net_elements import unpacked_network, walk_network

WalkwayKind = Literal["sidewalk", "walkingarea", "crossing"]

_FARTHEST_M = 1e8  # from the origin
_WIDTH_M = 3.2  # SUMO's default width of a lane
_LEAST_POINTS: dict[WalkwayKind, int] = {"sidewalk": 2, "crossing": 2, "walkingarea": 3}


@dataclass(frozen=True, eq=False)
class Walkway:
    """One sidewalk, walking area or crossing."""

    id: str  # id of its lane in the network
    kind: WalkwayKind
    shape: Float[np.ndarray, "point 2"]  # [m] the line along which one walks; for a walking area its outline
    width: float  # [m]
    signal: str | None = None  # id of the light of a crossing
    link: int = 0  # index of its letter

    @cached_property
    def line(self) -> shapely.LineString:
        """The line along which one walks [m], of a sidewalk or crossing."""
        return shapely.LineString(self.shape)

    @cached_property
    def area(self) -> shapely.geometry.base.BaseGeometry:
        """The area that it covers [m]."""
        if self.kind == "walkingarea":
            return shapely.Polygon(self.shape).buffer(0.0)  # outlines may cross themselves
        return self.line.buffer(0.5 * self.width, cap_style="flat")


def read_walkways(sumo_net: bytes | None) -> tuple[Walkway, ...]:
    """The walkways of a network (gzip) in its order; empty where there is no network or it has none.

    Raises InputError where the network is damaged.
    """
    if sumo_net is None:
        return ()
    content = unpacked_network(sumo_net)
    if b"pedestrian" not in content and b"walkingarea" not in content and b"crossing" not in content:
        return ()
    reader = _Reader()
    walk_network(content, len(sumo_net), reader.begin)
    return tuple(reader.walkways())


class _Reader:
    """An XML handler that collects walkways and the lights of crossings."""

    def __init__(self) -> None:
        self._function = ""
        self._found: dict[str, Walkway] = {}
        self._lights: dict[str, tuple[str, int]] = {}  # by the edge of the crossing

    def begin(self, tag: str, attributes: dict[str, str]) -> None:
        """Note the begin of an element of the network."""
        if tag == "edge":
            self._function = attributes.get("function", "")
        elif tag == "lane" and (kind := self._kind(attributes)) is not None:
            self._add(kind, attributes)
        elif tag == "connection" and "tl" in attributes:
            self._lights[attributes.get("to", "")] = attributes["tl"], int(attributes.get("linkIndex", "0"))

    def walkways(self) -> Iterator[Walkway]:
        """All walkways, crossings with their lights."""
        for one in self._found.values():
            signal, link = self._lights.get(one.id.rpartition("_")[0], (None, 0))
            yield replace(one, signal=signal, link=link) if one.kind == "crossing" else one

    def _kind(self, lane: dict[str, str]) -> WalkwayKind | None:
        if self._function == "crossing" or self._function == "walkingarea":
            return self._function
        walks = not self._function and _allows(lane, "pedestrian") and not _allows(lane, "passenger")
        return "sidewalk" if walks else None

    def _add(self, kind: WalkwayKind, lane: dict[str, str]) -> None:
        points = [place.split(",")[:2] for place in lane.get("shape", "").split()]
        shape, width = np.array(points, float).reshape(-1, 2), float(lane.get("width", _WIDTH_M))
        shape.setflags(write=False)
        name = lane.get("id", "")
        if not (np.abs(shape) < _FARTHEST_M).all() or not 0 < width < _FARTHEST_M:
            raise ValueError(f"lane {name!r} lies beyond {_FARTHEST_M:g} m or has no width")
        # netconvert writes some walkways whose points coincide
        if len(np.unique(shape, axis=0)) >= _LEAST_POINTS[kind]:
            self._found[name] = Walkway(name, kind, shape, width)


def _allows(lane: dict[str, str], vehicle_class: str) -> bool:
    """Whether a lane admits a vehicle class: `allow` lists it, or there is no `allow` and no `disallow` of it."""
    if "allow" in lane:
        return not {vehicle_class, "all"}.isdisjoint(lane["allow"].split())
    return {vehicle_class, "all"}.isdisjoint(lane.get("disallow", "").split())
