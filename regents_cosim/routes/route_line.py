"""The centre line of a route: along its lanes, over to the lane beside where it has to, and from the ego's place."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Float, Int

from regents_cosim.geometry.frames import Pose, wrap
from regents_cosim.geometry.lines import cubic, distances_along, evenly, length_of, points_at, straight_on
from regents_cosim.maps.roadmap import Lane
from regents_cosim.routes.ego_route import EXTENSION_M, LONGEST_M, SPACING_M

_CHANGE_S = 3.0  # a change of lanes takes this long ...
_CHANGE_M = 15.0  # ... and at least this way
_SHORTEST_M = 5.0  # even where the lane ends before


@dataclass(frozen=True)
class ChangeOfLane:
    """A change to the lane beside that the route needs."""

    lane: str
    to_lane: str
    from_m: float  # along the route: the change can begin here at the earliest ...
    until_m: float  # ... and has to be over by here
    begin_m: float  # where the centre line begins to change
    end_m: float


class RouteLine(NamedTuple):
    """A line with a point every `SPACING_M`, and the lanes on which it runs."""

    points: Float[np.ndarray, "point 2"]  # [m]
    lane: Int[np.ndarray, " point"]  # index of the lane in the order of the route
    begins: dict[int, float]  # where the line enters each lane that it runs on [m]
    changes: tuple[ChangeOfLane, ...]


class _Strip:
    """Lanes that continue each other, as one line."""

    def __init__(self, first: int, lanes: list[Lane]) -> None:
        points = np.concatenate([lane.centre for lane in lanes])
        self.along = distances_along(*points.T)
        self._points, self._line = points, shapely.LineString(points)
        last_points = np.cumsum([len(lane.centre) for lane in lanes]) - 1
        self.first, self.ends = first, self.along[last_points]
        self.last_begin = float(self.along[last_points[-1] - len(lanes[-1].centre) + 1])

    def at(self, along: Float[np.ndarray, " point"]) -> Float[np.ndarray, "point 2"]:
        return points_at(along, self.along, self._points)

    def locate(self, points: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, " point"]:
        return np.asarray(shapely.line_locate_point(self._line, shapely.points(points)))

    def lane(self, along: Float[np.ndarray, " point"]) -> Int[np.ndarray, " point"]:
        return self.first + np.minimum(np.searchsorted(self.ends, along, side="right"), len(self.ends) - 1)

    def between(self, begin: float, end: float) -> Float[np.ndarray, " point"]:
        """Distances from `begin` to `end` [m], every metre and wherever a lane ends."""
        inside = self.ends[(self.ends > begin) & (self.ends < end)]
        return np.unique(np.concatenate([np.arange(begin, end, SPACING_M), inside, [max(end, begin)]]))


class _Drawn:
    """The line so far, point by point."""

    def __init__(self) -> None:
        self._points, self._lane, self.length = [], [], 0.0

    def add(self, points: Float[np.ndarray, "point 2"], lane: Int[np.ndarray, " point"]) -> None:
        if len(points):
            joined = np.concatenate([self._points[-1][-1:], points]) if self._points else points
            self.length += length_of(joined)
            self._points.append(points)
            self._lane.append(lane)

    def all(self) -> tuple[Float[np.ndarray, "point 2"], Int[np.ndarray, " point"]]:
        return np.concatenate(self._points), np.concatenate(self._lane)


def line_along(
    lanes: Sequence[Lane], start: Pose, speed: float, target: tuple[float, float], begin_m: Sequence[float] | None
) -> RouteLine:
    """The line from `start` along `lanes`, of which each continues the one before or lies beside it.

    The ego's `speed` [m/s] gives the length of its lane changes. They begin at `begin_m` [m], or by default as late as
    reaches `target`.
    """
    strips, here = _strips(lanes), np.array([[start.x, start.y]], float)
    length = max(_CHANGE_M, _CHANGE_S * speed)
    drawn, changes = _Drawn(), list[ChangeOfLane]()
    along, free = float(strips[0].locate(here)[0]), 0.0
    offset = here[0] - strips[0].at(np.array([along]))[0]
    for number, (strip, beside) in enumerate(pairwise(strips)):
        more = len(strips) - 1 - number  # changes to come, this one included
        end = float(strip.ends[-1])
        origin = drawn.length - along  # from distances of the strip to those of the route
        first = max(strip.last_begin, along, free - origin)
        room = max(end - first, _SHORTEST_M)
        over = min(length, max(room / more, _SHORTEST_M))
        last = max(first, end - over * more)
        if begin_m is None:
            reached = float(strip.locate(np.array([target]))[0])
            begin = min(max(reached - over * more, first), last)
        else:
            begin = min(max(begin_m[min(number, len(begin_m) - 1)] - origin, first), last)
        way = strip.between(along, begin)
        drawn.add(strip.at(way), strip.lane(way))
        begun, way = drawn.length, np.arange(SPACING_M, over, SPACING_M)
        left = strip.at(np.minimum(begin + way, end))
        across = beside.locate(left)
        done = (way / over)[:, None]
        part = done**3 * (10.0 + done * (6.0 * done - 15.0))  # a quintic, without a jump of speed or acceleration
        side = np.where(way < 0.5 * over, strip.lane(begin + way), beside.lane(across))
        drawn.add((1.0 - part) * left + part * beside.at(across), side)
        along = float(beside.locate(strip.at(np.array([min(begin + over, end)])))[0])
        free = drawn.length
        changes.append(
            ChangeOfLane(
                lanes[beside.first - 1].id, lanes[beside.first].id, first + origin, end + origin, begun, drawn.length
            )
        )
    strip = strips[-1]
    reached = max(float(strip.locate(np.array([target]))[0]), along)
    way = strip.between(along, min(float(strip.ends[-1]), reached + LONGEST_M))
    drawn.add(strip.at(way), strip.lane(way))
    points, lane = drawn.all()
    points = straight_on(_from(points, offset, start, length), EXTENSION_M - SPACING_M)
    return _even(points, np.append(lane, lane[-1]), tuple(changes))


def line_without_lanes(start: Pose, target: tuple[float, float]) -> RouteLine:
    """A smooth curve from `start` to `target` (a cubic of Hermite), then straight on."""
    here, there = np.array([start.x, start.y], float), np.array(target, float)
    facing = np.array([np.cos(start.yaw), np.sin(start.yaw)], float)
    way = float(np.hypot(*(there - here)))
    if way < SPACING_M or float((there - here) @ facing) <= 0.0:  # it stands, or would have to turn round
        points = here + np.arange(0.0, 3.0)[:, None] * facing
    else:
        points = cubic(here, way * facing, there, there - here, max(int(way / SPACING_M), 2) + 1)
    points = straight_on(points, EXTENSION_M - SPACING_M)
    return _even(points, np.full(len(points), -1), ())


def _strips(lanes: Sequence[Lane]) -> list[_Strip]:
    """The parts of a route between its changes to a lane beside."""
    part, found = 0, list[int]()
    for index, lane in enumerate(lanes):
        part += bool(index) and lane.id in (lanes[index - 1].left, lanes[index - 1].right)
        found.append(part)
    runs = [[index for index, _ in run] for _, run in groupby(enumerate(found), key=lambda one: one[1])]
    return [_Strip(run[0], [lanes[index] for index in run]) for run in runs]


def _from(points: np.ndarray, offset: np.ndarray, start: Pose, length: float) -> np.ndarray:
    """The line begun at the ego's place, `offset` [m] beside it; an ego on its way back goes on as it is headed."""
    along = distances_along(*points.T)
    part = np.clip(along / length, 0.0, 1.0)[:, None]
    moved = points + (1.0 - part) ** 2 * (1.0 + 2.0 * part) * offset
    ahead = points[min(3, len(points) - 1)] - points[0]
    yaw = np.arctan2(ahead[1], ahead[0])
    normal = np.array([-np.sin(yaw), np.cos(yaw)])
    slope = float(np.tan(np.clip(wrap(np.asarray(start.yaw - yaw)), -0.5, 0.5)))
    if slope * float(offset @ normal) < 0.0:
        moved = moved + part * (1.0 - part) ** 2 * length * slope * normal
    return moved


def _even(points: np.ndarray, lane: np.ndarray, changes: tuple[ChangeOfLane, ...]) -> RouteLine:
    along = distances_along(*points.T)
    even = evenly(points, SPACING_M)
    at = np.clip(np.searchsorted(along, SPACING_M * np.arange(len(even)), side="right") - 1, 0, len(lane) - 1)
    first = np.flatnonzero(np.diff(lane, prepend=-2))
    return RouteLine(even, lane[at], {int(lane[i]): float(along[i]) for i in first.tolist() if lane[i] >= 0}, changes)
