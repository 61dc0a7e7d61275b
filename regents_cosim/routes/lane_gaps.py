"""Where to change lanes: the place from which a change keeps clear of those that are there now.

Each place is tried in thought: all others keep speed and heading, the ego follows by the Intelligent Driver Model
(Treiber, Hennecke and Helbing 2000, with the parameters of `planners.idm`) whatever is on its line, for 8 s. The place
counts on which it gets furthest, less what it costs to touch others, to make those behind brake, and to brake itself.
"""

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.norms.following import LEAST_GAP_M, braking_needed, desired_gap
from regents_cosim.norms.limits import ACCEL_LIMIT
from regents_cosim.routes.bodies import Bodies

_STEP_S, _STEPS = 0.25, 33
_ACCEL, _BRAKE, _HEADWAY_S, _STANDSTILL_M = 2.0, 3.0, 1.0, 2.0
_ASIDE_M = 0.3  # kept on either side
_TOUCHING_M = 0.3  # a gap along the line below this is none
# Costs, in metres of way.
_TOUCHED = 100.0  # for each step
_HARD_BRAKING = 0.5  # for each m/s of speed lost beyond 1 m/s^2
_FOLLOWER_BRAKES = 1.0  # for each m/s that a follower has to lose beyond 1 m/s^2
_FOLLOWER_NEAR = 0.3  # for each metre and second that a follower is nearer than 0.6 s and 1 m
_FOLLOWER_S, _FOLLOWER_M = 0.6, 1.0


def worth(
    line: Float[np.ndarray, "point 2"], speed: float, limit: float, size: tuple[float, float], others: Bodies
) -> float:
    """The worth [m] of a line for an ego at its begin; `speed` and `limit` [m/s], `size` length and width [m]."""
    there = np.flatnonzero(others.valid)
    along, aside = _places(line, others, there)
    reach = 0.5 * (others.length[there] + size[0])
    inside = aside < 0.5 * (others.width[there] + size[1])[:, None] + _ASIDE_M
    pace = others.speed[there]
    way, cost = 0.0, 0.0
    for step in range(_STEPS):
        gap = np.abs(along[:, step] - way) - reach
        ahead = inside[:, step] & (along[:, step] > way)
        behind = inside[:, step] & ~ahead
        cost += _TOUCHED * bool((gap[ahead | behind] < _TOUCHING_M).any())
        cost += _STEP_S * _behind(gap[behind], pace[behind], speed)
        accel = max(_follows(gap[ahead], pace[ahead], speed, limit), -ACCEL_LIMIT)
        cost += _STEP_S * _HARD_BRAKING * max(-accel - 1.0, 0.0)
        after = max(speed + accel * _STEP_S, 0.0)
        way, speed = way + 0.5 * (speed + after) * _STEP_S, after
    return way - cost


def _places(line: np.ndarray, others: Bodies, there: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where along the line and how far beside it [m] the others will be, [agent, step]."""
    x, y, yaw, speed = (values[there, None] for values in (others.x, others.y, others.yaw, others.speed))
    way = speed * _STEP_S * np.arange(_STEPS)
    points, path = shapely.points(x + way * np.cos(yaw), y + way * np.sin(yaw)), shapely.LineString(line)
    return np.asarray(shapely.line_locate_point(path, points)), np.asarray(shapely.distance(path, points))


def _follows(gap: np.ndarray, pace: np.ndarray, speed: float, limit: float) -> float:
    free = 1.0 - (speed / max(limit, 0.1)) ** 4
    wanted = desired_gap(np, speed, speed - pace, _HEADWAY_S, _STANDSTILL_M, _ACCEL, _BRAKE)
    return float(_ACCEL * (free - np.max((wanted / np.maximum(gap, LEAST_GAP_M)) ** 2, initial=0.0)))


def _behind(gap: np.ndarray, pace: np.ndarray, speed: float) -> float:
    braking = braking_needed(np, gap, pace - speed)
    near = np.maximum(_FOLLOWER_S * pace + _FOLLOWER_M - np.maximum(gap, LEAST_GAP_M), 0.0)
    return float(_FOLLOWER_BRAKES * np.maximum(braking - 1.0, 0.0).sum() + _FOLLOWER_NEAR * near.sum())
