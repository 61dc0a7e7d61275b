"""Match a path to lanes by the cheapest sequence of lanes, not by the nearest lane at each point.

Inside a junction several lanes begin at one place; only the sequence tells which of them the path follows, and with it
which light applies.
"""

import itertools
from operator import add

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.geometry.boxes import same_level
from regents_cosim.geometry.frames import wrap
from regents_cosim.maps.levels import height_on
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.norms.limits import ALONG_RAD

_REACH_M = 3.0
_CHANGE_COST_M = 2.0  # a lane change costs as much as one point at this distance from the centre line
_JUMP_COST_M = 30.0  # cost of a change between lanes that do not connect
_NOWHERE_COST_M = 2.0 * _REACH_M  # cost of a point on no lane


def match_lanes(
    road: RoadMap, points: Float[np.ndarray, "point 2"], z: Float[np.ndarray, " point"]
) -> list[Lane | None]:
    """The lane under every point [m] of a path at heights `z` [m]; None where no lane runs in the path's direction.

    Method: Viterbi over the lanes within 3 m and 45 degrees. A point costs its distance to the centre line, a change
    between lanes that do not continue each other costs extra. A single point has no direction, and so no lane.
    """
    if len(points) < 2:
        return [None] * len(points)
    options: list[list[tuple[Lane | None, float]]] = [
        [(None, _NOWHERE_COST_M), *near] for near in lanes_near(road, points, z)
    ]
    choices = [tuple(lane for lane, _ in near) for near in options]
    best = [cost for _, cost in options[0]]
    came_from: list[list[int]] = []
    # most points have the same lanes as the point before
    costs: dict[tuple[tuple[Lane | None, ...], ...], list[list[float]]] = {}
    for pair, now in zip(itertools.pairwise(choices), options[1:], strict=True):
        if pair not in costs:
            costs[pair] = [[_move_cost(a, b, road) for a in pair[0]] for b in pair[1]]
        back, least = [], []
        for moves, (_, cost) in zip(costs[pair], now, strict=True):  # a handful of numbers: NumPy takes longer
            values = list(map(add, moves, best))
            value = min(values)
            back.append(values.index(value))
            least.append(value + cost)
        came_from.append(back)
        best = least
    chosen = [int(np.argmin(best))]
    for back in reversed(came_from):
        chosen.append(back[chosen[-1]])
    return [lanes[index] for lanes, index in zip(choices, reversed(chosen), strict=True)]


def lanes_near(
    road: RoadMap, points: Float[np.ndarray, "point 2"], z: Float[np.ndarray, " point"]
) -> list[list[tuple[Lane, float]]]:
    """For every point of a path the lanes of its level that it may be on, with distances to centre lines [m]."""
    step = np.diff(points, axis=0, append=points[-1:] + (points[-1:] - points[-2:-1]))
    near = lanes_at(road, points, z, np.arctan2(step[:, 1], step[:, 0]))
    return [[(lane, abs(left)) for lane, left in options] for options in near]


def lanes_at(
    road: RoadMap,
    points: Float[np.ndarray, "point 2"],
    z: Float[np.ndarray, " point"],
    yaw: Float[np.ndarray, " point"],
) -> list[list[tuple[Lane, float]]]:
    """For every place [m] the lanes that a vehicle may be on there, with how far left of their centre lines it is [m].

    `z` [m] and `yaw` [rad] are the vehicle's height and direction.
    """
    where = np.asarray(shapely.points(points))
    index, lane = road.centre_lines.query(where, predicate="dwithin", distance=_REACH_M)
    line = road.centre_lines.geometries[lane]
    at = np.clip(shapely.line_locate_point(line, where[index]), 0.0, np.maximum(shapely.length(line) - 0.5, 0.0))
    ends = [shapely.get_coordinates(shapely.line_interpolate_point(line, at + ahead)) for ahead in (0.0, 0.5)]
    along = ends[1] - ends[0]
    turn = np.abs(wrap(np.arctan2(along[:, 1], along[:, 0]) - yaw[index]))
    off = points[index] - ends[0]
    away = np.copysign(shapely.distance(line, where[index]), along[:, 0] * off[:, 1] - along[:, 1] * off[:, 0])
    found: list[list[tuple[Lane, float]]] = [[] for _ in points]
    for i in np.flatnonzero(turn < ALONG_RAD):
        if not road.raised or same_level(height_on(road.lanes[lane[i]], points[index[i]]), z[index[i]]):
            found[index[i]].append((road.lanes[lane[i]], float(away[i])))
    return found


def _move_cost(before: Lane | None, after: Lane | None, road: RoadMap) -> float:
    if before is after or before is None or after is None:
        return 0.0
    if any(link.target == after.id for link in road.exits[before.id]):
        return 0.0
    return _CHANGE_COST_M if after.id in (before.left, before.right) else _JUMP_COST_M
