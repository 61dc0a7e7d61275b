"""The lines along which a candidate may lawfully drive: its logged path, every way ahead, and lane changes.

They come from `verdicts.law.lawful_ways`, are smoothed, and carry what a driver has to mind: the speed limit and the
lights. Most of them never come near the ego; lane changes that cannot come near are not drawn.
"""

import itertools
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Bool, Float

from regents_cosim.geometry.lines import evenly, length_of, straight_on, stretch
from regents_cosim.maps.right_of_way import priorities
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.norms.careful import CAREFUL
from regents_cosim.routes.ego_route import lanes_ahead, lanes_under, logged_path
from regents_cosim.scenario.scenario import RED, Scenario
from regents_cosim.verdicts.law.lane_pieces import lane_lines, neighbours
from regents_cosim.verdicts.law.lawful_ways import LawfulWay, ways_ahead

SPACING_M = 0.5  # between the points of a line
PULLING_OUT_M_S = 4.0  # a standing or crawling agent is taken to reach this speed soon

_SMOOTH_POINTS = 9  # lanes have kinks where they meet
_MOST_CHANGED_FROM = 4  # ways from which lane changes are drawn
_CHANGE_BEGINS_S = (0.0, 1.0, 2.5, 4.0)
_CHANGE_LASTS_S = (4.0, 7.0, 10.0)
_SHORTEST_CHANGE_M = 12.0
_PARTED_M = 1.0  # neighbours have parted if their middles are this much further apart than where the change begins
_JOIN_M = 6.0  # over which a logged path leads on into the middle of its lane
_EVERY_M = 2.0  # of its way, the ego's lane is looked up
_DECIMALS = 4  # of a metre: lines that differ by less are the same
SMOOTHED_M = 2.0  # the most that smoothing moves a line


@dataclass(frozen=True, eq=False)
class LightOnLine:
    """A traffic light on the line."""

    at_m: float  # along the line
    red: Bool[np.ndarray, " time"]


@dataclass(frozen=True, eq=False)
class DriveLine:
    """A lawful way as an evenly spaced line."""

    points: Float[np.ndarray, "point 2"]  # [m] every `SPACING_M`
    heading: Float[np.ndarray, " point"]  # [rad] continuous
    limit: float  # [m/s] where it begins
    shows_m: float = 0.0  # [m] distance from which a lane change can be noticed
    stop_lines: tuple[LightOnLine, ...] = ()
    lawful_m: float = np.inf  # [m] distance beyond which a pedestrian breaks the law
    kerbs_m: tuple[float, ...] = ()  # places where a pedestrian steps onto the carriageway without a green light
    yields: bool = False  # whether its movement through a junction gives way to the ego's

    @property
    def key(self) -> Hashable:
        """Equal for lines of vehicles along which drives are the same."""
        lights = tuple((round(light.at_m, _DECIMALS), light.red.tobytes()) for light in self.stop_lines)
        shape = (self.points.round(_DECIMALS) + 0.0).tobytes()  # -0.0 has other bytes than 0.0
        return shape, self.limit, round(self.shows_m, _DECIMALS), self.yields, lights

    def at(self, way: Float[np.ndarray, "*axes"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions [m, m] and headings [rad] at distances `way` [m] along the line."""
        along = np.arange(len(self.points)) * SPACING_M
        return tuple(np.interp(way, along, values) for values in (*self.points.T, self.heading))  # pyright: ignore


class AlongLines(NamedTuple):
    """The motion of agents that follow lines, [row time]."""

    along: Float[np.ndarray, "row time"]  # [m] on the line
    x: Float[np.ndarray, "row time"]  # [m]
    y: Float[np.ndarray, "row time"]  # [m]
    yaw: Float[np.ndarray, "row time"]  # [rad]

    def take(self, chosen: np.ndarray) -> "AlongLines":
        """Some of the rows, by mask or index."""
        return AlongLines(*(values[chosen] for values in self))


class ContactRange(NamedTuple):
    """Positions of the ego, and the greatest distance from them of the centre of an agent that touches it."""

    places: shapely.MultiPoint
    reach_m: float

    @classmethod
    def to(cls, x: Float[np.ndarray, " place"], y: Float[np.ndarray, " place"], reach_m: float) -> "ContactRange":
        """The neighbourhood of positions [m]."""
        places = shapely.MultiPoint(np.column_stack([x, y]))
        shapely.prepare(places)
        return cls(places, reach_m + SMOOTHED_M)

    def is_met_by(self, line: shapely.LineString, further_m: float = 0.0) -> bool:
        """Whether a line comes within reach, or within `further_m` more."""
        return bool(shapely.dwithin(self.places, line, self.reach_m + further_m))


class _Beside(NamedTuple):
    """A neighbour lane that one may change to, with the lanes straight on from it."""

    lanes: tuple[Lane, ...]
    middle: shapely.LineString


def lines_ahead(scenario: Scenario, agent: int, near: ContactRange) -> Iterator[DriveLine]:
    """The logged path, and those lawful ways ahead and lane changes from several places that may come `near`."""
    tracks = scenario.tracks
    first = int(np.argmax(tracks.valid[agent]))
    speed, fastest = float(tracks.speed[agent, first]), float(tracks.speed[agent].max())
    reach_m = 2.0 * fastest * tracks.steps * scenario.dt + 50.0
    ways = ways_ahead(scenario, agent)
    yield _logged(scenario, agent, next((way for way in ways if way.logged), None), reach_m)
    for index, way in enumerate(ways):
        if way.changes > 1:
            continue
        points = prolonged(way.points, reach_m)
        is_met, may_change = near.is_met_by(shapely.LineString(points)), way.changes == 0 and index < _MOST_CHANGED_FROM
        if not is_met and not may_change:
            continue
        line = line_through(points, _limit(way))
        line = replace(line, stop_lines=_stop_lines(scenario, way.lanes, line), yields=_yields(scenario, way.lanes))
        if is_met:
            yield line
        if may_change:
            yield from _changing(scenario, line, way, max(speed, PULLING_OUT_M_S), near)


def _limit(way: LawfulWay) -> float:
    """The speed limit [m/s] where a way begins."""
    return max(lane.speed_limit for lane in way.lanes[:2])


def _logged(scenario: Scenario, agent: int, taken: LawfulWay | None, reach_m: float) -> DriveLine:
    """The logged path, continued along the lanes that it took, or straight on where there are none."""
    path = logged_path(scenario.tracks, agent)
    if taken is None:
        return line_through(prolonged(path, reach_m), np.inf)
    onward = shapely.LineString(taken.points)
    joins_m = onward.project(shapely.Point(path[-1])) + _JOIN_M
    path = np.vstack([path, stretch(taken.points, joins_m)]) if joins_m < onward.length else path
    line = line_through(prolonged(path, reach_m), _limit(taken))
    return replace(line, stop_lines=_stop_lines(scenario, taken.lanes, line), yields=_yields(scenario, taken.lanes))


def _changing(
    scenario: Scenario, line: DriveLine, way: LawfulWay, speed: float, near: ContactRange
) -> Iterator[DriveLine]:
    """The way with a change to a neighbour lane, for several begins and durations.

    After the change the line follows the neighbour.
    """
    road, end_m, drawn = scenario.road, (len(line.points) - 1) * SPACING_M, shapely.LineString(line.points)
    lengths = [max(lasting_s * speed, _SHORTEST_CHANGE_M) for lasting_s in _CHANGE_LASTS_S]
    for begin_m in _begins(road, drawn, way, speed):
        some = [length_m for length_m in lengths if begin_m + length_m <= end_m]
        if not some:
            continue
        onward = line.points[int(begin_m / SPACING_M) :]
        beside = [one for one in _beside(road, way, onward[0], end_m) if _may_meet(near, onward, one)]
        moving = [_Moving.over(line, one.middle, begin_m, max(some)) for one in beside]
        for length_m, (one, move) in itertools.product(some, zip(beside, moving, strict=True)):
            changed = _changed(line, one.middle, begin_m, length_m, move)
            if changed is not None:
                before = tuple(stop for stop in line.stop_lines if stop.at_m <= begin_m + length_m)
                stops = *before, *_stop_lines(scenario, one.lanes, changed)
                yield replace(changed, stop_lines=stops, yields=_yields(scenario, (*way.lanes, *one.lanes)))


def _yields(scenario: Scenario, lanes: Sequence[Lane]) -> bool:
    """Whether one that takes these lanes gives way to the ego in a junction, as far as the map tells."""
    table = priorities(scenario.road)
    return table is not None and table.any_yields((lane.id for lane in lanes), _lanes_of_ego(scenario))


@lru_cache(maxsize=16)
def _lanes_of_ego(scenario: Scenario) -> frozenset[str]:
    """The lanes that the ego takes in its log."""
    lanes = lanes_under(scenario, 0, evenly(logged_path(scenario.tracks), _EVERY_M))
    return frozenset(lane.id for lane in lanes if lane is not None)


def _may_meet(near: ContactRange, onward: Float[np.ndarray, "point 2"], beside: _Beside) -> bool:
    """Whether a lane change from the first point of `onward` [m] may come near, as it stays between both lanes.

    A line that comes near before that place does so without the change.
    """
    begin = shapely.Point(onward[0])
    between_m = 0.5 * (shapely.distance(beside.middle, begin) + _PARTED_M)
    after = stretch(shapely.get_coordinates(beside.middle), beside.middle.project(begin))
    return any(near.is_met_by(shapely.LineString(points), between_m) for points in (onward, after))


def _begins(road: RoadMap, drawn: shapely.LineString, way: LawfulWay, speed: float) -> list[float]:
    """Distances [m] at which a lane change may begin: now, some seconds on, and where a lane gains a neighbour."""
    beside = neighbours(road)
    behind = [b for a, b in itertools.pairwise(way.lanes) if beside[b.id] and not beside[a.id]]
    places = [drawn.project(shapely.Point(lane.centre[0])) + SPACING_M for lane in behind]
    return [*(seconds * speed for seconds in _CHANGE_BEGINS_S), *places]


def _beside(road: RoadMap, way: LawfulWay, place: Float[np.ndarray, " 2"], end_m: float) -> list[_Beside]:
    """The neighbours that one may change to from `place`, on a way that ends at `end_m` [m]."""
    lines, at = lane_lines(road), shapely.Point(place)
    here = min(way.lanes, key=lambda lane: lines[lane.id].distance(at))
    onward = [tuple(lanes_ahead(road, road.lane[other], end_m)) for other in neighbours(road)[here.id]]
    middles = [np.concatenate([lane.centre for lane in lanes]) for lanes in onward]
    return [
        _Beside(lanes, shapely.LineString(prolonged(middle, end_m + SPACING_M)))
        for lanes, middle in zip(onward, middles, strict=True)
    ]


class _Moving(NamedTuple):
    """The part of a line from where a lane change begins, and the neighbour beside it."""

    along: Float[np.ndarray, " point"]  # [m] along the line
    own: Float[np.ndarray, "point 2"]  # [m]
    at: Float[np.ndarray, " point"]  # [m] along the neighbour
    beside: Float[np.ndarray, "point 2"]  # [m]
    apart: Float[np.ndarray, " point"]  # [m]

    @classmethod
    def over(cls, line: DriveLine, target: shapely.LineString, begin_m: float, length_m: float) -> "_Moving":
        """The part of a line over `length_m` [m], and the neighbour beside it."""
        along = np.arange(len(line.points)) * SPACING_M
        change = (along >= begin_m) & (along <= begin_m + length_m)
        own = line.points[change]
        places = shapely.points(own)
        at = np.asarray(shapely.line_locate_point(target, places))
        beside = shapely.get_coordinates(shapely.line_interpolate_point(target, at))
        return cls(along[change], own, at, beside, np.asarray(shapely.distance(target, places)))

    def until(self, end_m: float) -> "_Moving":
        """The part of it up to `end_m` [m] along the line."""
        count = int(np.searchsorted(self.along, end_m, side="right"))
        return _Moving(*(values[:count] for values in self))


def _changed(
    line: DriveLine, target: shapely.LineString, begin_m: float, length_m: float, moving: _Moving
) -> DriveLine | None:
    """The line that moves over to `target`, the middle of a neighbour and of the lanes after it, and stays there.

    None where the two part before the change is over: ways through a junction are neighbours only as long as they turn
    the same way.
    """
    along, own, at, beside, apart = moving.until(begin_m + length_m)
    if apart.max() > apart[0] + _PARTED_M:
        return None
    done = (along - begin_m) / length_m
    done = done - np.sin(2.0 * np.pi * done) / (2.0 * np.pi)
    rest = stretch(shapely.get_coordinates(target), at[-1] + SPACING_M)
    before = line.points[: round(along[0] / SPACING_M)]
    points = np.vstack([before, own + done[:, None] * (beside - own), rest])
    shows_m = float(along[np.argmax(done * apart > CAREFUL.wandering_m)])
    return replace(line_through(points, line.limit), shows_m=shows_m)


def _stop_lines(scenario: Scenario, lanes: Sequence[Lane], line: DriveLine) -> tuple[LightOnLine, ...]:
    """The lights that a line passes along lanes that continue each other."""
    signals = {signal.id: signal for signal in scenario.signals}
    drawn = shapely.LineString(line.points)
    found = []
    for lane, onward in itertools.pairwise(lanes):
        link = next((link for link in scenario.road.exits[lane.id] if link.target == onward.id), None)
        if link is not None and link.signal in signals:
            shown = [signals[link.signal].letters(step)[link.link] for step in range(scenario.tracks.steps)]
            at_m = float(drawn.project(shapely.Point(lane.centre[-1])))
            found.append(LightOnLine(at_m, np.array([letter in RED for letter in shown])))
    return tuple(found)


def prolonged(points: Float[np.ndarray, "point 2"], reach_m: float) -> Float[np.ndarray, "further 2"]:
    """The line, extended straight on to `reach_m` [m]."""
    return straight_on(points, max(reach_m - length_of(points), 1.0))


def line_through(points: Float[np.ndarray, "point 2"], limit: float) -> DriveLine:
    """A smooth line through points [m], with the speed limit [m/s] where it begins."""
    even = evenly(points, SPACING_M)
    smooth = np.stack([_smooth(even[:, axis]) for axis in (0, 1)], axis=1)
    even = evenly(smooth, SPACING_M)
    step = np.gradient(even, axis=0)
    return DriveLine(even, np.unwrap(np.arctan2(step[:, 1], step[:, 0])), limit)


def _smooth(values: Float[np.ndarray, " point"]) -> Float[np.ndarray, " point"]:
    """Smooth values twice by the mean of neighbours; the ends stay in place."""
    half = _SMOOTH_POINTS // 2
    for _ in range(2):
        before, after = 2.0 * values[0] - values[half:0:-1], 2.0 * values[-1] - values[-2 : -half - 2 : -1]
        padded = np.concatenate([before, values, after])
        values = np.convolve(padded, np.full(_SMOOTH_POINTS, 1.0 / _SMOOTH_POINTS), mode="valid")
    return values
