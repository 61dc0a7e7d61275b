"""Possible conflicts: where another road user can lawfully cross or join the path of an ego within a window.

A window in which the ego drives alone out of a junction tells nothing about its planner, because no other road user can
get in its way. So the lanes that lead on from the first position of each vehicle are followed. Where they lead onto the
ego's path, the vehicle is a possible conflict if it can be there when the ego passes, with accelerations of ordinary
traffic and without running a red light. A pedestrian is one if it can be on a crossing when the ego drives over it
(`steps_on_between`). The check uses lanes, lights and kinematics only, no planner and no search. A map whose lanes do
not connect has no conflicts, and heights are ignored.

The term is that of traffic engineering: a point that two movements have in common (Highway Capacity Manual).
"""

import itertools
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Literal

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.geometry.frames import wrap
from regents_cosim.geometry.lines import distances_along, heading_near, seconds_for
from regents_cosim.maps.right_of_way import priorities
from regents_cosim.maps.roadmap import Connection, Lane, RoadMap
from regents_cosim.maps.walkways import Walkway
from regents_cosim.norms.limits import ALONG_RAD, OVER_LIMIT, RSS_BRAKE_M_S2, RSS_RESPONSE_S
from regents_cosim.routes.lane_matching import match_lanes
from regents_cosim.scenario.scenario import RED, Scenario
from regents_cosim.simulators.sumo.types import VehicleType
from regents_cosim.sources.recording import Recording

# When a pedestrian may step onto a crossing so as to be in the way of an ego that drives over it.
#
# The pedestrian walks straight to one end of the crossing, without touching the ego's path, and then over it. At a
# crossing without lights the ego must still be far enough away to stop when the pedestrian steps on: stepping out
# closer breaks the law (`verdicts.law.offences_on_foot`).
_WALKS = 2.0  # [m/s] briskly: the median of recorded pedestrians is 1.4, the bound of an attack 3.0


@dataclass(frozen=True, eq=False)
class EgoPassage:
    """The event that an ego drives over a crossing."""

    crossing: Walkway
    path: shapely.LineString  # [m] the ego's path
    at: shapely.Point  # [m] where the path meets the middle of the crossing
    time_s: float
    speed: float  # [m/s] the ego's


def passage_over(
    crossing: Walkway, path: shapely.LineString, travelled: Float[np.ndarray, " time"], dt: float
) -> EgoPassage | None:
    """Where and when an ego first drives over a crossing; None if it does not.

    `path` is the ego's path [m], `travelled` how far along it the ego is [m] every `dt` [s].
    """
    met = shapely.get_parts(shapely.intersection(path, crossing.line))
    if not len(met):
        return None
    along, at = min((float(path.project(one.centroid)), number) for number, one in enumerate(met))
    step = min(int(np.searchsorted(travelled, along)), len(travelled) - 1)
    speed = float(travelled[step] - travelled[max(step - 1, 0)]) / dt
    return EgoPassage(crossing, path, met[at].centroid, step * dt, speed)


def steps_on_between(
    passed: EgoPassage, place: Float[np.ndarray, " 2"], since_s: float
) -> Iterator[tuple[float, float]]:
    """The earliest and latest times [s] at which a person may step on, for each end of the crossing.

    The person is at `place` [m] at the time `since_s` [s].
    """
    line = passed.crossing.line
    across_m = float(line.project(passed.at))
    seen_s = 0.0 if passed.crossing.signal is not None else RSS_RESPONSE_S + passed.speed / (2.0 * RSS_BRAKE_M_S2)
    for end, onward_m in ((0, across_m), (-1, line.length - across_m)):
        way = shapely.LineString([place, passed.crossing.shape[end]])
        soonest = since_s + way.length / _WALKS
        latest = passed.time_s - max(onward_m / _WALKS, seen_s)
        if soonest <= latest and not way.intersects(passed.path):
            yield soonest, latest


_REACH_M = 2.0  # from the middle of a lane
_AROUND_M = 80.0  # [m] from the ego's path, where other vehicles may begin
_LONGEST_M = 120.0
_MOST_WAYS = 16
_OFF_PATH_M = 2.5  # a route that joins or crosses a path was at least this far from it before
_ON_PATH_M = 1.5
_FIRST_S = 4.0  # earlier, no road user could have come into the ego's way and have been seen doing so
_GAIN = 2.5  # [m/s^2] of ordinary drivers (Treiber and Kesting 2013)
_BRAKE = 3.0  # [m/s^2]
_STEP_M = 1.0
_EVERY_M = 2.0  # of its way, the ego's lane is looked up

Others = Literal["all", "pedestrians"]  # who may come into the ego's way


@dataclass(frozen=True, eq=False)
class _OwnPath:
    """The path of the ego, and when the ego is at which point of it."""

    line: shapely.LineString
    travelled: Float[np.ndarray, " time"]  # [m]
    dt: float
    lanes: frozenset[str]

    @property
    def lasts_s(self) -> float:
        """The duration of the path [s]."""
        return (len(self.travelled) - 1) * self.dt

    @cached_property
    def around(self) -> tuple[float, float, float, float]:
        """The box [m] around all places less than `_OFF_PATH_M` away from the path: left, low, right, high."""
        left, low, right, high = self.line.bounds
        return left - _OFF_PATH_M, low - _OFF_PATH_M, right + _OFF_PATH_M, high + _OFF_PATH_M

    def away(self, points: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, " point"]:
        """The distance [m] of each point from the path; infinite outside `around`, which is cheap to tell."""
        left, low, right, high = self.around
        x, y = points.T
        near = (x > left) & (x < right) & (y > low) & (y < high)
        away = np.full(len(points), np.inf)
        away[near] = shapely.distance(self.line, shapely.points(points[near]))
        return away

    def time_s(self, along_m: float) -> float:
        """The time [s] at which the ego has driven `along_m` [m]."""
        return float(np.searchsorted(self.travelled, along_m)) * self.dt


@dataclass(frozen=True, eq=False)
class _LanesAhead:
    """A chain of lanes that begins where a vehicle is first seen."""

    points: Float[np.ndarray, "point 2"]  # [m] every metre
    lights: tuple[tuple[float, Connection], ...]  # the distance of the stop line [m]
    limit: float  # [m/s] the highest speed limit of these lanes
    begins: tuple[tuple[float, str], ...]  # the distance [m] and the id of each lane

    @cached_property
    def _bounds(self) -> tuple[float, float, float, float]:
        left, low = self.points.min(axis=0, initial=np.inf).tolist()
        right, high = self.points.max(axis=0, initial=-np.inf).tolist()
        return left, low, right, high

    def is_outside(self, box: tuple[float, float, float, float]) -> bool:
        """Whether all of the chain is outside a box [m]: left, low, right, high."""
        left, low, right, high = self._bounds
        return right < box[0] or high < box[1] or left > box[2] or low > box[3]

    def up_to(self, along_m: float) -> list[str]:
        """The ids of the lanes that begin up to a distance [m]."""
        return [name for begin_m, name in self.begins if begin_m <= along_m]


class Possible(IntEnum):
    """The road users that could cross or join the path of an ego."""

    NOBODY = 0
    OTHERS = 1  # others, as far as known none that it has to give way to
    WITH_RIGHT_OF_WAY = 2  # one that it has to give way to


def possible_conflict(scenario: Scenario, others: Others = "all") -> Possible:
    """Who of a window could cross or join the path of its ego."""
    tracks, kinds = scenario.tracks, (VehicleType(one.kind, one.length, one.width) for one in scenario.agents)
    ids = tuple(one.id for one in scenario.agents)
    motion = tracks.x, tracks.y, tracks.yaw, tracks.valid
    recording = Recording(0.0, scenario.dt, ids, tuple(kinds), *motion, scenario.signals, tracks.speed, z=tracks.z)
    return Conflicts(recording, scenario.road).possible_for(0, others)


class Conflicts:
    """The possible conflicts in one Recording. The lanes ahead of each vehicle are computed once."""

    def __init__(self, recording: Recording, road: RoadMap) -> None:
        self._recording, self._road = recording, road
        self._ways: dict[int, list[_LanesAhead]] = {}

    def possible_for(self, ego: int, others: Others = "all") -> Possible:
        """Who could cross or join the path of `ego`, which has to be present at every instant."""
        if not self._road.connections:
            return Possible.NOBODY
        x, y = self._recording.x[ego], self._recording.y[ego]
        travelled = distances_along(x, y)
        own = _OwnPath(
            shapely.LineString(np.stack([x, y], axis=-1)), travelled, self._recording.dt, self._lanes_of(ego)
        )
        shapely.prepare(own.line)
        near = list(self._near(ego, own))
        walking = [other for other in near if self._recording.types[other].kind == "pedestrian"]
        driving = [other for other in near if other not in walking] if others == "all" else []
        ways = ((other, way) for other in driving for way in self._ways_of(other))
        met = (self._goes_first(on, own) for other, way in ways if (on := self._may_meet(other, way, own)) is not None)
        on_foot = (self._goes_first({one.crossing.id}, own) for one in self._met_on_foot(walking, own))
        may_yield = self._may_yield(own)
        found = Possible.NOBODY
        for goes_first in itertools.chain(met, on_foot):
            if goes_first:
                return Possible.WITH_RIGHT_OF_WAY
            found = Possible.OTHERS
            if not may_yield:
                break
        return found

    def _lanes_of(self, ego: int) -> frozenset[str]:
        """The lanes that the ego takes, without those of a junction in which it is at first: it has gone on already."""
        x, y = self._recording.x[ego], self._recording.y[ego]
        some = np.flatnonzero(np.diff(np.hypot(x - x[0], y - y[0]) // _EVERY_M, prepend=-1.0))
        if len(some) < 2:
            return frozenset()
        lanes = match_lanes(self._road, np.stack([x, y], axis=-1)[some], self._recording.heights[ego][some])
        outside = itertools.dropwhile(lambda lane: lane is None or lane.junction, lanes)
        return frozenset(lane.id for lane in outside if lane is not None)

    def _may_yield(self, own: "_OwnPath") -> bool:
        """Whether the ego gives way to anybody at all on its lanes, as far as the map tells."""
        table = priorities(self._road)
        return table is not None and any(
            table.gives_way.get(table.links[one]) for one in own.lanes & table.links.keys()
        )

    def _goes_first(self, on: Collection[str], own: "_OwnPath") -> bool:
        """Whether the ego has to give way to one `on` these lanes, or on this crossing, as far as the map tells."""
        table = priorities(self._road)
        return table is not None and table.any_yields(own.lanes, on) and not table.any_yields(on, own.lanes)

    def _near(self, ego: int, own: _OwnPath) -> Iterator[int]:
        """The other vehicles that are first seen near the path, the nearest first."""
        rows = np.flatnonzero(self._recording.valid.any(axis=1))
        first = self._first[rows]
        begun = shapely.points(self._recording.x[rows, first], self._recording.y[rows, first])
        away = np.atleast_1d(shapely.distance(own.line, begun))
        order = np.argsort(away, kind="stable")
        yield from (int(rows[i]) for i in order if away[i] <= _AROUND_M and rows[i] != ego)

    def _met_on_foot(self, walking: list[int], own: _OwnPath) -> Iterator[EgoPassage]:
        """The crossings on which one of these pedestrians could lawfully be when the ego drives over them."""
        crossings = [way for way in self._road.walkways if way.kind == "crossing"] if walking else []
        met = itertools.compress(crossings, shapely.intersects(own.line, [way.line for way in crossings]))
        found = [one for way in met if (one := passage_over(way, own.line, own.travelled, own.dt)) is not None]
        passed = [one for one in found if _FIRST_S <= one.time_s < own.lasts_s]
        yield from (one for one in passed if any(self._may_step_on(other, one) for other in walking))

    def _may_step_on(self, other: int, passed: EgoPassage) -> bool:
        """Whether a pedestrian could step onto the crossing in time, not on red, and be on it when the ego arrives."""
        first, dt = int(self._first[other]), self._recording.dt
        place = np.array([self._recording.x[other, first], self._recording.y[other, first]])
        return bool(self._recording.valid[other, round(passed.time_s / dt)]) and any(
            self._may_go(passed.crossing, *times) for times in steps_on_between(passed, place, first * dt)
        )

    @cached_property
    def _first(self) -> np.ndarray:
        return np.argmax(self._recording.valid, axis=1)

    def _may_meet(self, other: int, way: _LanesAhead, own: _OwnPath) -> list[str] | None:
        """The lanes up to where they lead onto the ego's path; None where the other cannot be there when the ego is."""
        if way.is_outside(own.around):
            return None
        away = own.away(way.points)
        joins = np.flatnonzero((np.maximum.accumulate(away) > _OFF_PATH_M) & (away < _ON_PATH_M))
        if not len(joins):
            return None
        passes_s = own.time_s(float(own.line.project(shapely.Point(way.points[joins[0]]))))
        if not _FIRST_S <= passes_s < own.lasts_s or not self._recording.valid[other, round(passes_s / own.dt)]:
            return None
        at_m = float(joins[0]) * _STEP_M
        return way.up_to(at_m) if self._may_arrive(other, way, at_m, passes_s) else None

    def _may_arrive(self, other: int, way: _LanesAhead, at_m: float, time_s: float) -> bool:
        """Whether a vehicle can be `at_m` along its lanes at a time [s], given the lights on the way."""
        first = int(self._first[other])
        begun, speed = first * self._recording.dt, float(self._recording.speed[other, first])
        most = max(OVER_LIMIT * way.limit, speed)
        soonest, latest = _arrives(at_m, speed, most)
        stops = [(stop_m, link) for stop_m, link in way.lights if stop_m <= at_m]
        return soonest <= time_s - begun <= latest and all(
            self._may_go(link, begun + _arrives(stop_m, speed, most)[0], time_s) for stop_m, link in stops
        )

    def _may_go(self, link: Connection | Walkway, since_s: float, until_s: float) -> bool:
        """Whether the light shows go at some step between two times [s]."""
        signal = next((one for one in self._recording.signals if one.id == link.signal), None)
        steps = range(int(since_s / self._recording.dt), int(until_s / self._recording.dt) + 1)
        return signal is None or any(
            signal.letters(step)[link.link : link.link + 1] not in tuple(RED) for step in steps
        )

    def _ways_of(self, vehicle: int) -> list[_LanesAhead]:
        if vehicle not in self._ways:
            self._ways[vehicle] = list(self._found_ways(vehicle))
        return self._ways[vehicle]

    def _found_ways(self, vehicle: int) -> Iterator[_LanesAhead]:
        first = int(self._first[vehicle])
        x, y, yaw = (values[vehicle, first] for values in (self._recording.x, self._recording.y, self._recording.yaw))
        begun = _lane_under(self._road, shapely.Point(x, y), float(yaw))
        waiting = [] if begun is None else [((begun[0],), (), begun[1])]
        found = 0
        while waiting and found + len(waiting) < _MOST_WAYS:
            lanes, links, along = waiting.pop(0)
            onward = self._road.exits[lanes[-1].id]
            so_far = sum(lane.length for lane in lanes) - along
            if so_far >= _LONGEST_M or not onward:
                found += 1
                yield _way_on(lanes, links, along)
                continue
            waiting += [((*lanes, self._road.lane[link.target]), (*links, link), along) for link in onward]
        yield from (_way_on(*one) for one in waiting)


def _lane_under(road: RoadMap, place: shapely.Point, yaw: float) -> tuple[Lane, float] | None:
    """The nearest lane that runs in the direction `yaw`, and how far along it the place is [m]."""
    near = [road.lanes[i] for i in sorted(road.centre_lines.query(place, predicate="dwithin", distance=_REACH_M))]
    along = [lane for lane in near if abs(float(wrap(heading_near(lane.line, place) - yaw))) < ALONG_RAD]
    nearest = min(along, key=lambda lane: lane.line.distance(place), default=None)
    return None if nearest is None else (nearest, nearest.line.project(place))


def _way_on(lanes: tuple[Lane, ...], links: tuple[Connection, ...], along: float) -> _LanesAhead:
    line = shapely.LineString(np.concatenate([lane.centre for lane in lanes]))
    at = np.arange(along, min(along + _LONGEST_M, line.length), _STEP_M)
    points = shapely.get_coordinates(shapely.line_interpolate_point(line, at)).reshape(-1, 2)
    ends = np.cumsum([lane.length for lane in lanes]) - along
    lights = tuple((float(end), link) for end, link in zip(ends, links, strict=False) if link.signal is not None)
    begins = tuple(zip([0.0, *map(float, ends[:-1])], [lane.id for lane in lanes], strict=True))
    return _LanesAhead(points, lights, max(lane.speed_limit for lane in lanes), begins)


def _arrives(distance_m: float, speed: float, most: float) -> tuple[float, float]:
    """The earliest and the latest time [s] at which a vehicle can have driven a distance; infinite if it can stop
    before.
    """
    soonest, left = seconds_for(distance_m, speed, _GAIN, most), speed**2 - 2.0 * _BRAKE * distance_m
    return float(soonest), np.inf if left <= 0.0 else float((speed - np.sqrt(left)) / _BRAKE)
