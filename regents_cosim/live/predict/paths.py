"""Paths of vehicles: the centre lines of the lanes ahead, joined smoothly from the current position.

As in SUMO both the front bumper and the rear follow the path.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from regents_cosim.geometry.lines import evenly, straight_on, stretch, without_repeats
from regents_cosim.maps.roadmap import Lane, RoadMap

SPACING_M = 1.0
BEHIND_M = 20  # points of a path behind the front bumper
BEFORE_LINE_M = 1.0  # a vehicle waits this far before a line, or nearer if that needs less braking
_JOIN_S = 3.0  # duration of the return to the centre line
_SHORTEST_JOIN_M = 12.0
_LEAST_M_S = 1.0  # speed limit where there is no lane, unless the vehicle is faster
_SHORTEST_M, _LONGEST_M, _MARGIN = 20.0, 300.0, 1.2  # shortest and longest path, and factor on the distance driven
_SPARE_M = 2.0  # by which lines are longer than asked for
_SEARCHED = 8  # most lanes of a path through a junction


@dataclass(frozen=True, eq=False)
class Stop:
    """A line before which a vehicle has to wait at times: for a red light, or for traffic with priority."""

    at_m: float  # [m] from the front bumper
    shut_s: tuple[float, float] = (0.0, np.inf)  # [s] begin and end of the time to wait
    seen_m: float = -np.inf  # [m] a vehicle this close no longer has to wait


@dataclass(frozen=True, eq=False)
class Crossing:
    """A path through a junction."""

    lane: str  # its first lane inside
    enters_m: float  # [m] from the front bumper
    leaves_m: float  # [m] from the front bumper to its end
    gives_way: bool = True  # unless its light gives it priority at all times


@dataclass(frozen=True, eq=False)
class Path:
    """A path as points every metre: `BEHIND_M` of them behind the front bumper, the rest ahead."""

    points: Float[np.ndarray, "point 2"]  # [m]
    limit: Float[np.ndarray, " point"]  # [m/s] speed limit of the lane there
    ends_m: float  # [m] from the front bumper to the end of the route; infinite if it continues
    stops: tuple[Stop, ...] = ()
    crossings: tuple[Crossing, ...] = ()


def reach_within(seconds: float, fastest: float) -> float:
    """The length of a path [m] for `seconds` [s] at most at the speed `fastest` [m/s]."""
    return min(_SHORTEST_M + _MARGIN * fastest * seconds, _LONGEST_M)


def path_along(
    lanes: Sequence[Lane],
    along_m: float,
    front: tuple[float, float],
    yaw: float,
    speed: float,
    reach_m: float,
    arrives: bool = False,
) -> Path:
    """The path of a vehicle whose front bumper is beside the first of `lanes`, `along_m` [m] from its begin.

    It joins the centre line within a few seconds, and goes straight on where the lanes end.
    """
    centre, limit, length = _middle(lanes, along_m, reach_m)
    place, heading = np.array(front), np.array([np.cos(yaw), np.sin(yaw)])
    if len(centre) < 2:
        centre = place + np.array([[0.0], [1.0]]) * heading
        limit = np.full(2, lanes[0].speed_limit if lanes else max(speed, _LEAST_M_S))
    ends_m = length if arrives and length < reach_m else np.inf
    return joined(centre, limit, front, yaw, speed, reach_m, ends_m)


def joined(
    centre: Float[np.ndarray, "point 2"],
    limit: Float[np.ndarray, " metre"],
    front: tuple[float, float],
    yaw: float,
    speed: float,
    reach_m: float,
    ends_m: float = np.inf,
) -> Path:
    """The path along a line that begins beside the front bumper; `limit` is the speed limit [m/s] at every metre."""
    place, heading = np.array(front), np.array([np.cos(yaw), np.sin(yaw)])
    centre = evenly(straight_on(centre, reach_m + _SPARE_M), SPACING_M)[: int(reach_m) + 1]
    join_m = max(_JOIN_S * speed, _SHORTEST_JOIN_M)
    done = np.clip(np.arange(len(centre)) * SPACING_M / join_m, 0.0, 1.0)
    left = 1.0 - (done - np.sin(2.0 * np.pi * done) / (2.0 * np.pi))
    ahead = centre + left[:, None] * (place - centre[0])
    behind = place - np.arange(BEHIND_M, 0, -1)[:, None] * SPACING_M * heading
    limits = np.concatenate([np.full(BEHIND_M, limit[0]), limit, np.full(len(centre), limit[-1])])
    points = np.concatenate([behind, ahead])
    return Path(points, limits[: len(points)], ends_m)


def path_of_drive(places: Float[np.ndarray, "time 2"], yaw: Float[np.ndarray, " time"], length_m: float) -> Path:
    """The path of a vehicle whose centre is at the given `places` [m] in turn, continued straight."""
    heading = np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
    front = places + 0.5 * length_m * heading
    line = without_repeats(front)
    line = np.vstack([line, line[-1] + SPACING_M * heading[-1]])
    behind = front[0] - np.arange(BEHIND_M, 0, -1)[:, None] * SPACING_M * heading[0]
    points = np.concatenate([behind, evenly(straight_on(line, _SHORTEST_M + _SPARE_M), SPACING_M)])
    return Path(points, np.full(len(points), np.inf), np.inf)


def _middle(lanes: Sequence[Lane], along_m: float, reach_m: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Points on the centre lines from a place on the first lane, the limit at every metre, and the length [m]."""
    points, limits, length = [np.zeros((0, 2))], [np.zeros(0)], 0.0
    since = along_m
    for lane in lanes:
        points.append(stretch(lane.centre, since) if since > 0.0 else lane.centre)
        here = max(lane.length - since, 0.0)
        whole = int(length + here) - int(length)
        limits.append(np.full(whole, lane.speed_limit))
        length += here
        since = 0.0
        if length > reach_m:
            break
    limit, joined = np.concatenate(limits), without_repeats(np.concatenate(points))
    return joined, limit if len(limit) else np.full(1, lanes[0].speed_limit if lanes else np.inf), length


class LaneChains:
    """Finds the internal lanes between two lanes of a map."""

    def __init__(self, road: RoadMap) -> None:
        self._road = road
        self._known: dict[tuple[str, str], tuple[str, ...] | None] = {}

    def between(self, source: str, target: str) -> tuple[str, ...] | None:
        """The lanes after `source` up to and including `target`; None if no path through a junction leads there."""
        if (source, target) not in self._known:
            self._known[source, target] = self._search(source, target)
        return self._known[source, target]

    def _search(self, source: str, target: str) -> tuple[str, ...] | None:
        waiting: list[tuple[str, ...]] = [(source,)]
        while waiting:
            way = waiting.pop(0)
            for link in self._road.exits.get(way[-1], ()):
                if link.target == target:
                    return (*way[1:], target)
                if self._road.lane[link.target].junction and len(way) < _SEARCHED:
                    waiting.append((*way, link.target))
        return None

    def out_of_junction(self, lane: str) -> tuple[str, ...]:
        """The lanes after an internal lane, up to the first outside the junction; empty for any other lane."""
        found: list[str] = []
        while self._road.lane[lane].junction and self._road.exits[lane] and len(found) < _SEARCHED:
            lane = self._road.exits[lane][0].target
            found.append(lane)
        return tuple(found)

    def lanes(self, names: Sequence[str]) -> list[Lane]:
        """The lanes with these names, up to the first that is not on the map."""
        return [self._road.lane[name] for name in itertools.takewhile(self._road.lane.__contains__, names)]
