"""RoadMap: lanes, their connections and the drivable area. Frame: the map's own, metres."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
import shapely
from jaxtyping import Bool, Float
from shapely.geometry.base import BaseGeometry

from regents_cosim.checks.names import require_id
from regents_cosim.errors import require
from regents_cosim.geometry.areas import prepared
from regents_cosim.geometry.lines import length_of
from regents_cosim.maps.walkways import Walkway, read_walkways
from regents_cosim.short_repr import ShortRepr

# What signs tell a driver who comes along a lane: others wait; he waits; he stops first; who comes from the right goes
# first.
Approach = Literal["priority", "yields", "stops", "right_first"]

MOST_COORDINATE_M = 2.1e7  # half way around the Earth, as in Web Mercator; UTM's northings end at 1e7


@dataclass(frozen=True, eq=False, repr=False)
class Lane(ShortRepr):
    """One lane, or one way through a junction."""

    id: str
    centre: Float[np.ndarray, "point 2"]  # [m] in the direction of travel
    width: float  # [m]
    speed_limit: float  # [m/s]
    junction: bool = False  # an internal lane, inside a junction
    left: str | None = None  # id of the neighbour that one may change to
    right: str | None = None
    height: Float[np.ndarray, " point"] = None  # pyright: ignore  # [m] of the points of `centre`; 0 everywhere unless given
    approach: Approach | None = None  # by the signs of a log's map at its end or begin; None: the map does not tell

    def __post_init__(self) -> None:
        require_id(self.id, "lane id")
        centre = np.array(self.centre, float)
        height = np.zeros(len(centre)) if self.height is None else np.array(self.height, float)
        for name, values in (("centre", centre), ("height", height)):
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        require(
            centre.ndim == 2 and centre.shape[1] == 2 and len(centre) >= 2,
            f"lane {self.id}: centre line of shape {centre.shape}, expected at least two points [x, y]",
        )
        require(
            height.shape == centre.shape[:1],
            f"lane {self.id}: {height.size} heights, expected {len(centre)}, one for each point of its centre line",
        )
        require(
            bool(np.isfinite(centre).all() and np.isfinite(height).all()),
            f"lane {self.id}: centre line holds NaN or infinite numbers",
        )
        require(
            bool((np.abs(centre) <= MOST_COORDINATE_M).all()),
            f"lane {self.id}: a point is further than {MOST_COORDINATE_M:g} m from 0 (look for a mistake in its unit)",
        )
        require(self.width > 0, f"lane {self.id}: width {self.width} m, expected a positive number")

    @cached_property
    def length(self) -> float:
        """Length of the centre line [m]."""
        return length_of(self.centre)

    @cached_property
    def line(self) -> shapely.LineString:
        """The centre line [m]."""
        return shapely.LineString(self.centre)


@dataclass(frozen=True)
class Connection:
    """A lane that continues into another; `signal` and `link` name the traffic light in front of it."""

    source: str
    target: str
    signal: str | None = None  # id of a Signal
    link: int = 0  # index into the letters of the signal


@dataclass(frozen=True, eq=False)
class RoadMap:
    """Lanes, connections and drivable area of one map.

    `sumo_net` is the network file (gzip) where the map came from SUMO, so that a Scenario can be replayed in SUMO on a
    machine that does not have the original file.
    """

    lanes: tuple[Lane, ...]
    connections: tuple[Connection, ...]
    drivable: BaseGeometry  # polygon or multipolygon [m]
    sumo_net: bytes | None = field(default=None, repr=False)
    crossings: tuple[Walkway, ...] | None = None  # in the map of a log; None: it does not tell them

    def __post_init__(self) -> None:
        ids = {lane.id for lane in self.lanes}
        require(len(ids) == len(self.lanes), "lane ids of a map must differ from each other")
        require(not self.drivable.is_empty, "the drivable area of a map is empty")
        require(
            bool((np.abs(self.drivable.bounds) <= MOST_COORDINATE_M).all()),
            f"the drivable area reaches further than {MOST_COORDINATE_M:g} m from 0, or holds NaN",
        )
        for link in self.connections:
            for end in (link.source, link.target):
                require(end in ids, f"a connection names lane {end}, which the map does not have")

    def __repr__(self) -> str:
        return f"RoadMap({len(self.lanes)} lanes, {len(self.connections)} connections)"

    @cached_property
    def raised(self) -> bool:
        """Whether its lanes have heights; otherwise everything is at height 0."""
        return any(lane.height.any() for lane in self.lanes)

    @cached_property
    def lane(self) -> dict[str, Lane]:
        """All lanes by id."""
        return {lane.id: lane for lane in self.lanes}

    @cached_property
    def exits(self) -> dict[str, tuple[Connection, ...]]:
        """The connections that leave each lane, by lane id."""
        return self._by_lane(lambda link: link.source)

    @cached_property
    def entries(self) -> dict[str, tuple[Connection, ...]]:
        """The connections that lead into each lane, by lane id."""
        return self._by_lane(lambda link: link.target)

    def _by_lane(self, lane_of: Callable[[Connection], str]) -> dict[str, tuple[Connection, ...]]:
        found: dict[str, list[Connection]] = {lane.id: [] for lane in self.lanes}
        for link in self.connections:
            found[lane_of(link)].append(link)
        return {lane: tuple(links) for lane, links in found.items()}

    @cached_property
    def walkways(self) -> tuple[Walkway, ...]:
        """Sidewalks, walking areas and crossings of a map from SUMO, the crossings of one from a log."""
        return (*read_walkways(self.sumo_net), *(self.crossings or ()))

    @cached_property
    def centre_lines(self) -> shapely.STRtree:
        """Spatial index of the centre lines, in the order of `lanes`."""
        return shapely.STRtree([lane.line for lane in self.lanes])

    def contains(self, points: Float[np.ndarray, "... 2"]) -> Bool[np.ndarray, "..."]:
        """Whether points [m] lie on the drivable area."""
        return shapely.contains_xy(prepared(self.drivable), points[..., 0], points[..., 1])
