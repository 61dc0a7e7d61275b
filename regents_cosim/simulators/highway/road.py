"""Turns a RoadMap into a road network of highway-env, cropped to the surroundings of a scenario.

Adjacent lanes become one road, the leftmost first, so that highway-env's lane changes go to the correct side.
highway-env's own polyline lanes fail below 1 m and misplace vehicles at kinks by metres, hence `CentreLine`.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import shapely
from highway_env.road.lane import AbstractLane, CircularLane, LineType, StraightLane
from highway_env.road.road import LaneIndex, RoadNetwork
from jaxtyping import Float

from regents_cosim.geometry.frames import points_to_highway, wrap
from regents_cosim.maps.roadmap import Lane, RoadMap

Number = float | int  # highway-env passes either

AROUND_M = 30.0  # lanes farther from all tracks are left out
_APART_M = 0.05  # points of a centre line closer than this are merged
_ON_ARC_M = 1e-4  # the points of highway-env's own arcs lie nearer to a circle than this


def build_network(road: RoadMap, tracks: Float[np.ndarray, "point 2"], around_m: float = AROUND_M) -> RoadNetwork:
    """The network of lanes within `around_m` of any of the points `tracks` [m], or of the nearest lane without any."""
    kept = _near(road, tracks, around_m)
    right_of = _right_of(road)
    nodes = _Nodes(road, right_of)
    network = SharedNetwork()
    for lanes in _roads(road, kept, right_of):
        for index, lane in enumerate(lanes):
            beside = [lanes[i] for i in (index - 1, index + 1) if 0 <= i < len(lanes)]
            forbidden = any(lane.id not in (other.left, other.right) for other in beside)
            network.add_lane(*nodes.of(lane), _lane(lane, index == 0, index == len(lanes) - 1, forbidden))
    return network


def route_along(network: RoadNetwork, way: Sequence[Lane]) -> list[LaneIndex]:
    """The lanes of `way`, found by their midpoints, as far as they connect in the cropped network."""
    route: list[LaneIndex] = []
    lines = np.array([lane.line for lane in way])
    ends = (
        shapely.get_coordinates(shapely.line_interpolate_point(lines, share, normalized=True)) for share in (0.5, 0.55)
    )
    middles, further = map(points_to_highway, ends)
    for point, ahead in zip(middles, further - middles, strict=True):
        index = network.get_closest_lane_index(point, float(np.arctan2(ahead[1], ahead[0])))
        if not route or index[0] == route[-1][1]:
            route.append(index)
    return route


class SharedNetwork(RoadNetwork):
    """Lanes that copies of an environment share, as they do not change."""

    def __deepcopy__(self, memo: dict[int, Any]) -> "SharedNetwork":
        return self


class CentreLine(AbstractLane):
    """A lane along a line of points, straight beyond its ends."""

    def __init__(
        self,
        points: Float[np.ndarray, "point 2"],
        width: float,
        line_types: Any,
        speed_limit: float,
        forbidden: bool = False,
    ) -> None:
        self.points, self.width = points, width
        self.line_types, self.speed_limit = line_types, speed_limit
        self.forbidden, self.priority = forbidden, 0  # forbidden: no vehicle may change to it
        steps = np.diff(points, axis=0)
        self._lengths = np.hypot(*steps.T)
        self._directions = steps / self._lengths[:, None]
        self._headings = np.arctan2(steps[:, 1], steps[:, 0])
        self._starts = np.concatenate([[0.0], np.cumsum(self._lengths)[:-1]])
        self.length = float(self._lengths.sum())
        # The first and the last piece extend to infinity.
        self._least, self._most = np.zeros_like(self._lengths), self._lengths.copy()
        self._least[0], self._most[-1] = -np.inf, np.inf

    def __deepcopy__(self, memo: dict[int, Any]) -> "CentreLine":
        return self  # as `SharedNetwork`

    def position(self, longitudinal: Number, lateral: Number) -> np.ndarray:
        """The point `lateral` m to the right of the line, `longitudinal` m along it."""
        piece = self._piece(longitudinal)
        ahead = self._directions[piece]
        on_line = self.points[piece] + (longitudinal - self._starts[piece]) * ahead
        return on_line + lateral * np.array([-ahead[1], ahead[0]])

    def local_coordinates(self, position: np.ndarray) -> tuple[float, float]:
        """The inverse of `position`, from the nearest point of the line."""
        along, lateral = self.beside(np.asarray(position)[None])
        return float(along[0]), float(lateral[0])

    def beside(self, places: Float[np.ndarray, "place 2"]) -> tuple[np.ndarray, np.ndarray]:
        """The local coordinates of several places."""
        away = places[:, None] - self.points[:-1]
        along = np.clip((away * self._directions).sum(axis=-1), self._least, self._most)
        off = away - along[..., None] * self._directions
        each, piece = np.arange(len(places)), np.argmin((off**2).sum(axis=-1), axis=-1)
        (x, y), ahead = off[each, piece].T, self._directions[piece]
        return self._starts[piece] + along[each, piece], y * ahead[:, 0] - x * ahead[:, 1]

    def heading_at(self, longitudinal: Number) -> float:
        """Direction of the line [rad]."""
        return float(self._headings[self._piece(longitudinal)])

    def width_at(self, longitudinal: Number) -> float:
        """The constant width of the lane [m]."""
        return self.width

    def _piece(self, longitudinal: Number) -> int:
        return int(np.clip(np.searchsorted(self._starts, longitudinal, "right") - 1, 0, len(self._starts) - 1))


def beside_lane(lane: AbstractLane, places: Float[np.ndarray, "place 2"]) -> tuple[np.ndarray, np.ndarray]:
    """How far along a lane of `build_network` places are, and how far to the right of its centre line [m]."""
    if isinstance(lane, CentreLine):
        return lane.beside(places)
    if isinstance(lane, CircularLane):
        away = places - lane.center
        turned = np.asarray(wrap(np.arctan2(away[:, 1], away[:, 0]) - lane.start_phase))
        return lane.direction * turned * lane.radius, lane.direction * (lane.radius - np.hypot(*away.T))
    assert isinstance(lane, StraightLane)
    away = places - lane.start
    return away @ lane.direction, away @ lane.direction_lateral


def _near(road: RoadMap, tracks: Float[np.ndarray, "point 2"], around_m: float) -> set[str]:
    found = road.centre_lines.query(shapely.MultiPoint(tracks), predicate="dwithin", distance=around_m)
    indices = np.unique(found) if len(found) else road.centre_lines.nearest(shapely.points(tracks[:1]))
    return {road.lanes[i].id for i in np.atleast_1d(indices).tolist()}


def _right_of(road: RoadMap) -> dict[str, str]:
    """For every lane the one to its right, even where a lane change is allowed in one direction only."""
    named = {lane.id: lane.right for lane in road.lanes if lane.right is not None}
    return named | {lane.left: lane.id for lane in road.lanes if lane.left is not None}


def _roads(road: RoadMap, kept: set[str], right_of: dict[str, str]) -> Iterator[list[Lane]]:
    """Groups of adjacent lanes, from left to right; every kept lane occurs once."""
    left_of = {right: left for left, right in right_of.items()}
    done: set[str] = set()
    for lane in road.lanes:
        if lane.id in kept and lane.id not in done:
            name = lane.id
            while left_of.get(name) in kept - done and left_of[name] != lane.id:
                name = left_of[name]
            group = [name]
            while right_of.get(group[-1]) in kept - done - set(group):
                group.append(right_of[group[-1]])
            done |= set(group)
            yield [road.lane[member] for member in group]


class _Nodes:
    """Names of nodes: lane ends that are joined by connections or neighbours share one."""

    def __init__(self, road: RoadMap, right_of: dict[str, str]) -> None:
        self._same: dict[str, str] = {}
        for link in road.connections:
            self._join(f"{link.source}|e", f"{link.target}|s")
        for left, right in right_of.items():
            self._join(f"{left}|s", f"{right}|s")
            self._join(f"{left}|e", f"{right}|e")

    def of(self, lane: Lane) -> tuple[str, str]:
        """The nodes where `lane` begins and ends."""
        begin, end = self._find(f"{lane.id}|s"), self._find(f"{lane.id}|e")
        return begin, end if end != begin else f"{end}|loop"

    def _join(self, a: str, b: str) -> None:
        self._same[self._find(a)] = self._find(b)

    def _find(self, name: str) -> str:
        while name in self._same and self._same[name] != name:
            name = self._same[name]
        return name


def _lane(lane: Lane, leftmost: bool, rightmost: bool, forbidden: bool) -> AbstractLane:
    points = _without_repeats(points_to_highway(lane.centre))
    # CONTINUOUS_LINE is drawn straight from end to end, whatever the lane's shape.
    lines: Any = [
        LineType.CONTINUOUS if leftmost else LineType.STRIPED,
        LineType.CONTINUOUS if rightmost else LineType.NONE,
    ]
    if lane.junction:
        lines = [LineType.NONE, LineType.NONE]
    if len(points) == 2:
        return StraightLane(points[0], points[1], lane.width, lines, forbidden, lane.speed_limit)
    arc = _arc(points)
    if arc is not None:
        return CircularLane(*arc, lane.width, lines, forbidden, lane.speed_limit)
    return CentreLine(points, lane.width, lines, lane.speed_limit, forbidden)


def _arc(points: Float[np.ndarray, "point 2"]) -> tuple[np.ndarray, float, float, float, bool] | None:
    """Centre, radius [m], first and last phase [rad] and sense of the circle on which all points lie, if there is one.

    Distances along a lane, by which highway-env orders what an agent sees, go on round such a circle.
    """
    chords = 2.0 * (points[[len(points) // 2, -1]] - points[0])
    if abs(np.linalg.det(chords)) < 1e-6:  # straight
        return None
    centre = np.linalg.solve(chords, (points[[len(points) // 2, -1]] ** 2).sum(axis=1) - (points[0] ** 2).sum())
    away = points - centre
    radii, phases = np.hypot(*away.T), np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
    if np.ptp(radii) > _ON_ARC_M or abs(phases[-1] - phases[0]) > 2.0 * np.pi:
        return None
    return centre, float(radii[0]), float(phases[0]), float(phases[-1]), bool(phases[-1] > phases[0])


def _without_repeats(points: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "kept 2"]:
    """The points without those too close to the previous one; the first and the last are kept."""
    kept = [points[0]]
    for point in points[1:-1]:
        if np.hypot(*(point - kept[-1])) >= _APART_M and np.hypot(*(point - points[-1])) >= _APART_M:
            kept.append(point)
    return np.array([*kept, points[-1]])
