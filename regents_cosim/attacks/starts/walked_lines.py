"""The lines along which a pedestrian may meet the ego: its log's, straight across from it, and over crossings.

Where the map shows the law for pedestrians, the lines carry it: how far along they are lawful, where to wait for a
light, and where the carriageway begins. A walk begins with the pedestrian's own heading, and cuts the corners of its
line. The mirror's model of a pedestrian can follow it within its bounds (`driving_limits`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from regents_cosim.attacks.descent.driving_limits import SLOWEST_TURN_M_S, STEADY_TURN
from regents_cosim.attacks.starts.drive_lines import (
    SPACING_M,
    AlongLines,
    ContactRange,
    DriveLine,
    LightOnLine,
    line_through,
    prolonged,
)
from regents_cosim.geometry.frames import wrap
from regents_cosim.geometry.lines import distances_along, midway, points_at, steps_along
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.norms.limits import MOST_SPEED_M_S, OFF_ROAD_M, OVER_LIMIT
from regents_cosim.routes.ego_route import logged_path
from regents_cosim.scenario.scenario import RED, Scenario
from regents_cosim.verdicts.law.walking_ground import WalkingGround, ground_of
from regents_cosim.verdicts.ordinary import DrivingLimits

_LEAVES_S = (0.0, 1.5, 3.0)  # times at which it leaves its logged path
_AIMS = 8  # places of the ego's way to which it walks from there
_NEAREST_M = 1.0  # a nearer place gives no direction
_BEYOND_M = 10.0  # length that it walks on beyond the ego's way
_LIMIT_M_S = MOST_SPEED_M_S["pedestrian"] / OVER_LIMIT  # drives may exceed the limits of lines by OVER_LIMIT


def walked_lines(scenario: Scenario, agent: int, near: ContactRange, lawful: bool) -> Iterator[DriveLine]:
    """The extended logged path, and paths that leave it for a place on the ego's way, or for a crossing."""
    tracks, ground = scenario.tracks, ground_of(scenario) if lawful else None
    seconds = (tracks.steps - 1) * scenario.dt
    reach_m = seconds * MOST_SPEED_M_S["pedestrian"] + _BEYOND_M
    path = prolonged(logged_path(tracks, agent), reach_m)
    off_m = 0.0 if ground is None else max(OFF_ROAD_M, ground.off_in_log_m(scenario, agent))
    routes = None if ground is None else Routes(scenario.road, ground, path[0], reach_m, off_m)
    ways = [(0.0, path)]
    there = np.flatnonzero(tracks.valid[agent])
    for leaves_s in _LEAVES_S:
        step = there[min(round(leaves_s / scenario.dt), len(there) - 1)]
        gone = slice(there[0], step + 1)
        gone_m = float(steps_along(tracks.x[agent, gone], tracks.y[agent, gone]).sum())
        left_m = MOST_SPEED_M_S["pedestrian"] * (seconds - step * scenario.dt)
        place = np.array([tracks.x[agent, step], tracks.y[agent, step]])
        onward = [aim[None] for aim in _aims(near, place, left_m)]
        onward += [] if routes is None else list(routes.over_crossings(place, near, left_m))
        ways += [(gone_m, _leaving(path, gone_m, points, reach_m)) for points in onward]
    for gone_m, points in ways:
        line = replace(line_through(points, _LIMIT_M_S), shows_m=gone_m)
        yield line if ground is None else _under_the_law(scenario, agent, ground, line, off_m)


def _aims(near: ContactRange, place: Float[np.ndarray, " 2"], reach_m: float) -> Float[np.ndarray, "aim 2"]:
    """Some places of the ego's way, evenly distributed, that can be reached from `place` in time."""
    places = shapely.get_coordinates(near.places)
    away = np.hypot(*(places - place).T)
    places = places[(away > _NEAREST_M) & (away < reach_m + near.reach_m)]
    chosen = np.unique(np.linspace(0, len(places) - 1, _AIMS).round().astype(int)) if len(places) else []
    return places[chosen]


def _leaving(
    path: Float[np.ndarray, "point 2"], gone_m: float, onward: Float[np.ndarray, "further 2"], reach_m: float
) -> Float[np.ndarray, "whole 2"]:
    """The path for `gone_m` [m], then straight lines through the places of `onward` and beyond."""
    along = distances_along(*path.T)
    leaves = points_at(gone_m, along, path)
    return prolonged(np.vstack([path[along < gone_m - _NEAREST_M], leaves, onward]), reach_m)


def _under_the_law(scenario: Scenario, agent: int, ground: WalkingGround, line: DriveLine, off_m: float) -> DriveLine:
    """The line with the requirements of `verdicts.law.offences_on_foot`; `off_m` [m] off the ground is tolerated."""
    beyond, street = np.flatnonzero(ground.off_m(line.points) > off_m), ground.on_carriageway(line.points)
    lit = [way for way in ground.around(line.points) if scenario.shows(way.signal, way.link, 0) != "-"]
    on_lit, lights = np.zeros(len(street), bool), list[LightOnLine]()
    for way in lit:
        on = street & shapely.contains_xy(way.area, *line.points.T)
        on_lit |= on
        steps = range(scenario.tracks.steps)
        red = np.array([scenario.shows(way.signal, way.link, step) in RED for step in steps])
        front_m = 0.5 * scenario.agents[agent].length  # the law asks for its centre
        lights += [LightOnLine(at * SPACING_M + front_m, red) for first in _entered(on) for at in (first - 1, first)]
    kerbs = [at * SPACING_M for at in _entered(street) if not on_lit[at]]
    lawful_m = (beyond[0] - 1) * SPACING_M if len(beyond) else np.inf
    return replace(line, lawful_m=float(lawful_m), kerbs_m=tuple(kerbs), stop_lines=tuple(lights))


def _entered(on: Bool[np.ndarray, " point"]) -> list[int]:
    """The points of a line that are the first on something."""
    return (np.flatnonzero(on[1:] & ~on[:-1]) + 1).tolist()


_MOST_PLACES = 80  # in one route: the nearest


class Routes:
    """Shortest routes of straight pieces between the ends and bends of sidewalks and crossings.

    A piece is possible where all of it is on allowed ground, extended by `off_m` [m].
    """

    def __init__(
        self, road: RoadMap, ground: WalkingGround, place: Float[np.ndarray, " 2"], reach_m: float, off_m: float
    ) -> None:
        self._allowed = ground.allowed(place - reach_m, place + reach_m, off_m)
        shapely.prepare(self._allowed)
        around = shapely.Point(place)
        self._crossings = [way for way in ground.crossings if shapely.dwithin(way.area, around, reach_m)]
        beside = [way for way in road.walkways if way.kind != "crossing" and shapely.dwithin(way.area, around, reach_m)]
        points = [_places(way.kind == "walkingarea", way.shape) for way in beside]
        ends = np.array([way.shape[at] for way in self._crossings for at in (0, -1)]).reshape(-1, 2)
        others = np.vstack([np.empty((0, 2)), *points])
        near = np.argsort(np.hypot(*(others - place).T), kind="stable")[:_MOST_PLACES]
        self._places = np.vstack([ends, others[near]])
        self._apart = np.stack([self._away(one) for one in self._places]) if len(self._places) else np.empty((0, 0))

    def over_crossings(
        self, place: Float[np.ndarray, " 2"], near: ContactRange, left_m: float
    ) -> Iterator[Float[np.ndarray, "point 2"]]:
        """Routes from a place over each crossing that comes `near` the ego, if its begin is within `left_m` [m]."""
        wanted = [i for i, way in enumerate(self._crossings) if near.is_met_by(way.line)]
        if not wanted:
            return
        from scipy.sparse.csgraph import dijkstra  # takes long to import, and few attack on foot

        count = len(self._places)
        apart = np.zeros((count + 1, count + 1))  # 0: no way
        apart[:count, :count], apart[count, :count] = self._apart, self._away(place)
        away, before = dijkstra(apart, indices=count, return_predecessors=True)
        for crossing in wanted:
            for end in (2 * crossing, 2 * crossing + 1):
                if away[end] > left_m:
                    continue
                chain = [end]
                while before[chain[-1]] not in (count, -9999):
                    chain.append(int(before[chain[-1]]))
                shape = self._crossings[crossing].shape[:: 1 if end % 2 == 0 else -1]
                yield np.vstack([self._places[chain[:0:-1]], shape])

    def _away(self, place: Float[np.ndarray, " 2"]) -> Float[np.ndarray, " place"]:
        """Distances [m] to the places that can be reached straight from `place`; 0 for others."""
        straight = shapely.linestrings(np.stack([np.broadcast_to(place, self._places.shape), self._places], axis=1))
        can_go = shapely.covers(self._allowed, straight)
        return np.where(can_go, np.maximum(shapely.length(straight), 1e-6), 0.0)


def _places(area: bool, shape: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "place 2"]:
    """The places of a walkway: the line of a sidewalk, or the middle of a walking area."""
    return shape if not area else shapely.get_coordinates(shapely.point_on_surface(shapely.Polygon(shape).buffer(0.0)))


_AHEAD_M, _AHEAD_S = 0.5, 0.5  # it heads for a place this far ahead on the line, plus its way in this time
_OF_FASTEST = 0.998 * STEADY_TURN  # share of the fastest turn, as the search works in single precision


# --- walks along a line -------------------------------------------------------------------------


def walk(
    lines: Sequence[DriveLine],
    line: Int[np.ndarray, " row"],
    begun: tuple[float, float, float],
    speed: Float[np.ndarray, "row time"],
    dt: float,
    limits: DrivingLimits,
) -> AlongLines:
    """Walks from one pose `begun` [m, m, rad] with the given speeds [m/s], each along the line of its index `line`."""
    points, heading = np.concatenate([one.points for one in lines]), np.concatenate([one.heading for one in lines])
    ends = np.cumsum([len(one.points) for one in lines])
    first, last = np.concatenate([[0], ends[:-1]])[line], ends[line] - 1
    pace = midway(speed)
    fastest = _OF_FASTEST * limits.lateral_accel * dt / np.maximum(pace, SLOWEST_TURN_M_S)
    state = np.empty((speed.shape[1], 4, len(line)))  # along, x, y, yaw
    state[0] = np.array([0.0, *begun])[:, None]
    for step in range(speed.shape[1] - 1):
        along, x, y, yaw = state[step]
        goal = points[_index(first, last, along + _AHEAD_M + _AHEAD_S * pace[:, step])]
        turn = wrap(np.arctan2(goal[:, 1] - y, goal[:, 0] - x) - yaw)
        turn = np.clip(turn, -fastest[:, step], fastest[:, step])
        mid, moved = yaw + 0.5 * turn, pace[:, step] * dt
        onward = moved * np.maximum(np.cos(mid - heading[_index(first, last, along)]), 0.0)
        state[step + 1] = along + onward, x + moved * np.cos(mid), y + moved * np.sin(mid), yaw + turn
    return AlongLines(*np.moveaxis(state, (1, 2), (0, 1)))


def _index(
    first: Int[np.ndarray, " row"], last: Int[np.ndarray, " row"], along: Float[np.ndarray, " row"]
) -> Int[np.ndarray, " row"]:
    """The indices of the points nearest to the distances `along` [m] on their lines."""
    return np.minimum(first + np.rint(along / SPACING_M).astype(int), last)
