"""The lines that a pedestrian may walk along to meet the ego: its log's, and from it straight across the ego's way."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.attacks.drive_lines import DriveLine, Near, line_through, prolonged
from regents_cosim.limits import MOST_SPEED_M_S, OVER_LIMIT
from regents_cosim.routes.ego_route import logged_path
from regents_cosim.scenario import Scenario

_LEAVES_S = (0.0, 1.5, 3.0)  # its logged path, after so long
_AIMS = 8  # places of the ego's way that are walked to from there
_NEAREST_M = 1.0  # a place that is nearer gives no direction
_BEYOND_M = 10.0  # it walks on behind the ego's way
_LIMIT_M_S = MOST_SPEED_M_S["pedestrian"] / OVER_LIMIT  # drives may exceed the limits of lines by as much


def walked_lines(scenario: Scenario, agent: int, near: Near) -> Iterator[DriveLine]:
    """The logged path and on, and those that leave it for a place near which the ego passes."""
    tracks = scenario.tracks
    seconds = (tracks.steps - 1) * scenario.dt
    reach_m = seconds * MOST_SPEED_M_S["pedestrian"] + _BEYOND_M
    path = prolonged(logged_path(tracks, agent), reach_m)
    yield line_through(path, _LIMIT_M_S)
    there = np.flatnonzero(tracks.valid[agent])
    for leaves_s in _LEAVES_S:
        step = there[min(round(leaves_s / scenario.dt), len(there) - 1)]
        gone_m = float(np.hypot(*np.diff(np.stack([tracks.x, tracks.y])[:, agent, there[0] : step + 1])).sum())
        left_m = MOST_SPEED_M_S["pedestrian"] * (seconds - step * scenario.dt)
        for aim in _aims(near, np.array([tracks.x[agent, step], tracks.y[agent, step]]), left_m):
            yield _leaving(path, gone_m, aim, reach_m)


def _aims(near: Near, place: Float[np.ndarray, " 2"], reach_m: float) -> Float[np.ndarray, "aim 2"]:
    """Some places of the ego's way that can be reached from a place in time, evenly over them."""
    places = shapely.get_coordinates(near.places)
    away = np.hypot(*(places - place).T)
    places = places[(away > _NEAREST_M) & (away < reach_m + near.reach_m)]
    chosen = np.unique(np.linspace(0, len(places) - 1, _AIMS).round().astype(int)) if len(places) else []
    return places[chosen]


def _leaving(
    path: Float[np.ndarray, "point 2"], gone_m: float, aim: Float[np.ndarray, " 2"], reach_m: float
) -> DriveLine:
    """Along the path for so many metres, then straight to a place and on."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    leaves = np.array([np.interp(gone_m, along, path[:, axis]) for axis in (0, 1)])
    points = prolonged(np.vstack([path[along < gone_m - _NEAREST_M], leaves, aim]), reach_m)
    return replace(line_through(points, _LIMIT_M_S), shows_m=gone_m)
