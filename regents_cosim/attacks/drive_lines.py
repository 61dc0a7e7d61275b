"""The lines that a candidate may drive along lawfully: its logged path, every way ahead, and changes of lane.

They come from `verdicts.ways`, are smoothed, and carry what a driver on them has to mind: the limit, and the lights.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import shapely
from jaxtyping import Bool, Float

from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.planners.reference.parameters import CAREFUL
from regents_cosim.routes.ego_route import evenly, logged_path
from regents_cosim.scenario import RED, Scenario
from regents_cosim.verdicts.lane_pieces import lane_lines, neighbours
from regents_cosim.verdicts.ways import Way, ways_ahead

SPACING_M = 0.5  # of the points of a line
PULLING_OUT_M_S = 4.0  # one that stands or crawls is taken to get so fast soon

_SMOOTH_POINTS = 9  # lanes have kinks where they meet
_MOST_CHANGED_FROM = 4  # ways from which lanes are changed
_CHANGE_BEGINS_S = (0.0, 1.0, 2.5, 4.0)
_CHANGE_LASTS_S = (4.0, 7.0, 10.0)
_SHORTEST_CHANGE_M = 12.0


@dataclass(frozen=True, eq=False)
class LightOnLine:
    """A light on the line."""

    at_m: float  # along the line
    red: Bool[np.ndarray, " time"]


@dataclass(frozen=True, eq=False)
class DriveLine:
    """A lawful way as an evenly spaced line."""

    points: Float[np.ndarray, "point 2"]  # [m] every `SPACING_M`
    heading: Float[np.ndarray, " point"]  # [rad] continuous
    limit: float  # [m/s] where it begins
    shows_m: float = 0.0  # so far along, a change of lane can be noticed
    stop_lines: tuple[LightOnLine, ...] = ()

    def at(self, way: Float[np.ndarray, "*axes"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places [m, m] and headings [rad] so many metres along."""
        along = np.arange(len(self.points)) * SPACING_M
        return tuple(np.interp(way, along, values) for values in (*self.points.T, self.heading))  # pyright: ignore


def lines_ahead(scenario: Scenario, agent: int) -> Iterator[DriveLine]:
    """The logged path, the lawful ways ahead, and changes of lane from several places on."""
    tracks = scenario.tracks
    first = int(np.argmax(tracks.valid[agent]))
    speed, fastest = float(tracks.speed[agent, first]), float(tracks.speed[agent].max())
    reach_m = 2.0 * fastest * tracks.steps * scenario.dt + 50.0
    ways = ways_ahead(scenario, agent)
    logged = _line(_prolonged(logged_path(tracks, agent), reach_m), np.inf)
    taken = next((way for way in ways if way.logged), None)
    yield logged if taken is None else replace(logged, stop_lines=_stop_lines(scenario, taken, logged))
    for index, way in enumerate(ways):
        if way.changes > 1:
            continue
        line = _line(_prolonged(way.points, reach_m), max(lane.speed_limit for lane in way.lanes[:2]))
        line = replace(line, stop_lines=_stop_lines(scenario, way, line))
        yield line
        if way.changes == 0 and index < _MOST_CHANGED_FROM:
            yield from _changing(scenario.road, line, way, max(speed, PULLING_OUT_M_S))


def _changing(road: RoadMap, line: DriveLine, way: Way, speed: float) -> Iterator[DriveLine]:
    """The way, with a change to a neighbour that begins sooner or later and takes longer or less long."""
    along = np.arange(len(line.points)) * SPACING_M
    across = np.stack([-np.sin(line.heading), np.cos(line.heading)], axis=1)
    for begin_s, lasting_s in itertools.product(_CHANGE_BEGINS_S, _CHANGE_LASTS_S):
        begin_m, length_m = begin_s * speed, max(lasting_s * speed, _SHORTEST_CHANGE_M)
        if begin_m + length_m > along[-1]:
            continue
        place = int(begin_m / SPACING_M)
        for aside in _neighbours_aside(road, way, line.points[place], across[place]):
            done = np.clip((along - begin_m) / length_m, 0.0, 1.0)
            shift = aside * (done - np.sin(2.0 * np.pi * done) / (2.0 * np.pi))
            shows_m = float(along[np.argmax(np.abs(shift) > CAREFUL.wandering_m)])
            changed = _line(line.points + shift[:, None] * across, line.limit)
            yield replace(changed, shows_m=shows_m, stop_lines=line.stop_lines)


def _neighbours_aside(
    road: RoadMap, way: Way, place: Float[np.ndarray, " 2"], left: Float[np.ndarray, " 2"]
) -> list[float]:
    """How far to the left of a place on the way [m] the middles are of the lanes that one may change to from there."""
    lines, at = lane_lines(road), shapely.Point(place)
    here = min(way.lanes, key=lambda lane: lines[lane.id].distance(at))
    found = [
        np.array(lines[other].interpolate(lines[other].project(at)).coords[0]) for other in neighbours(road)[here.id]
    ]
    return [float((other - place) @ left) for other in found]


def _stop_lines(scenario: Scenario, way: Way, line: DriveLine) -> tuple[LightOnLine, ...]:
    """The lights that the way passes."""
    signals = {signal.id: signal for signal in scenario.signals}
    drawn = shapely.LineString(line.points)
    found = []
    for lane, onward in itertools.pairwise(way.lanes):
        link = next((link for link in scenario.road.exits[lane.id] if link.target == onward.id), None)
        if link is not None and link.signal in signals:
            shown = [signals[link.signal].letters(step)[link.link] for step in range(scenario.tracks.steps)]
            at_m = float(drawn.project(shapely.Point(lane.centre[-1])))
            found.append(LightOnLine(at_m, np.array([letter in RED for letter in shown])))
    return tuple(found)


def _prolonged(points: Float[np.ndarray, "point 2"], reach_m: float) -> Float[np.ndarray, "further 2"]:
    """The line, straight on to that length."""
    left = reach_m - float(np.hypot(*np.diff(points, axis=0).T).sum())
    ahead = points[-1] - points[-2]
    return np.vstack([points, points[-1] + max(left, 1.0) * ahead / np.hypot(*ahead)])


def _line(points: Float[np.ndarray, "point 2"], limit: float) -> DriveLine:
    even = evenly(points, SPACING_M)
    smooth = np.stack([_smooth(even[:, axis]) for axis in (0, 1)], axis=1)
    even = evenly(smooth, SPACING_M)
    step = np.gradient(even, axis=0)
    return DriveLine(even, np.unwrap(np.arctan2(step[:, 1], step[:, 0])), limit)


def _smooth(values: Float[np.ndarray, " point"]) -> Float[np.ndarray, " point"]:
    """Twice the mean of the neighbours, the ends where they are."""
    half = _SMOOTH_POINTS // 2
    for _ in range(2):
        before, after = 2.0 * values[0] - values[half:0:-1], 2.0 * values[-1] - values[-2 : -half - 2 : -1]
        padded = np.concatenate([before, values, after])
        values = np.convolve(padded, np.full(_SMOOTH_POINTS, 1.0 / _SMOOTH_POINTS), mode="valid")
    return values
