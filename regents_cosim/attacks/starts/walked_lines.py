"""The lines along which a pedestrian may meet the ego: its log's, straight across from it, and over crossings.

Where the map shows the law for pedestrians, the lines carry it: how far along they are lawful, where to wait for a
light, and where the carriageway begins.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import shapely
from jaxtyping import Bool, Float

from regents_cosim.attacks.starts.drive_lines import (
    SPACING_M,
    ContactRange,
    DriveLine,
    LightOnLine,
    line_through,
    prolonged,
)
from regents_cosim.attacks.starts.walked_routes import Routes
from regents_cosim.norms.limits import MOST_SPEED_M_S, OFF_ROAD_M, OVER_LIMIT
from regents_cosim.routes.ego_route import logged_path
from regents_cosim.scenario import RED, Scenario
from regents_cosim.verdicts.law.walking_ground import WalkingGround, ground_of, letter_at

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
        gone_m = float(np.hypot(*np.diff(np.stack([tracks.x, tracks.y])[:, agent, there[0] : step + 1])).sum())
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
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    leaves = np.array([np.interp(gone_m, along, path[:, axis]) for axis in (0, 1)])
    return prolonged(np.vstack([path[along < gone_m - _NEAREST_M], leaves, onward]), reach_m)


def _under_the_law(scenario: Scenario, agent: int, ground: WalkingGround, line: DriveLine, off_m: float) -> DriveLine:
    """The line with the requirements of `verdicts.law.offences_on_foot`; `off_m` [m] off the ground is tolerated."""
    beyond, street = np.flatnonzero(ground.off_m(line.points) > off_m), ground.on_carriageway(line.points)
    lit = [way for way in ground.around(line.points) if letter_at(scenario, way, 0) != "-"]
    on_lit, lights = np.zeros(len(street), bool), list[LightOnLine]()
    for way in lit:
        on = street & shapely.contains_xy(way.area, *line.points.T)
        on_lit |= on
        red = np.array([letter_at(scenario, way, step) in RED for step in range(scenario.tracks.steps)])
        front_m = 0.5 * scenario.agents[agent].length  # the law asks for its centre
        lights += [LightOnLine(at * SPACING_M + front_m, red) for first in _entered(on) for at in (first - 1, first)]
    kerbs = [at * SPACING_M for at in _entered(street) if not on_lit[at]]
    lawful_m = (beyond[0] - 1) * SPACING_M if len(beyond) else np.inf
    return replace(line, lawful_m=float(lawful_m), kerbs_m=tuple(kerbs), stop_lines=tuple(lights))


def _entered(on: Bool[np.ndarray, " point"]) -> list[int]:
    """The points of a line that are the first on something."""
    return (np.flatnonzero(on[1:] & ~on[:-1]) + 1).tolist()
