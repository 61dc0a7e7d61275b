"""Rules over arrays for what spoils a crash as a test of the planner: `xp` is NumPy or jax.numpy.

`verdicts.clean` asks them of a finished case, and `attacks.accept.acceptance` of every collision that a search comes
across.
"""

from typing import Any

import numpy as np

from regents_cosim.norms.limits import ABOVE_LOG_M_S2, REAR_FACE, REAR_PART, SAME_WAY_COS, STANDING_M_S

_CORNERS = np.array([[1, 1, -1, -1], [1, -1, -1, 1]], np.float32)[..., None]  # in their order around a box
_PARALLEL_M = 1e-6  # an edge that goes less far along an axis is parallel to the other one


def last_step(xp: Any, there: Any, step: Any) -> Any:
    """The two steps [before, at contact] that lead to `step`; the same step twice where an agent appears at it.

    `there` [time] says at which steps both agents are seen.
    """
    before = xp.maximum(step - 1, 0)
    return xp.stack([xp.where(there[before], before, step), step])


def rear_ends_ego(turn_cos: Any, met_at: Any, ahead_m: Any) -> Any:
    """Whether the adversary drives the ego's way, from behind it, into its rear face.

    `turn_cos` is the cosine between the headings at the contact, `met_at` where on the ego it is met (`contact_share`),
    `ahead_m` how far the adversary's centre is ahead of the ego's then [m].
    """
    return (turn_cos > SAME_WAY_COS) & (met_at < REAR_FACE) & (ahead_m < 0.0)


def comes_from_behind(met_at: Any, ahead_before_m: Any, ego_half_length: Any) -> Any:
    """Whether the adversary meets the rear part of the ego and was behind it `FROM_BEHIND_S` before."""
    return (met_at < REAR_PART) & (ahead_before_m < -ego_half_length)


def harder_than(xp: Any, needed: Any, most: Any, in_log: Any) -> Any:
    """Whether accelerations [m/s^2] exceed `most`, and clearly those of the same road user's log."""
    return needed > xp.maximum(most, in_log + ABOVE_LOG_M_S2)


def felt_acceleration(xp: Any, speed_change: Any, turned: Any, mean_speed: Any, seconds: Any) -> Any:
    """Acceleration [m/s^2], braking and steering together, of a change of speed [m/s] and heading [rad] in `seconds`.

    A mean over some tenths of a second: a single step is true for the motion of a model, but in a log it is noise.
    """
    return xp.hypot(speed_change, mean_speed * turned) / seconds


def contact_share(xp: Any, x: Any, y: Any, cos: Any, sin: Any, half_length: Any, half_width: Any) -> Any:
    """The middle of two boxes' intersection, along the ego: 0 at the ego's rear end, 1 at its front.

    All are arrays [2] of the ego and the other: centres and half sizes [m], cosines and sines of the headings. The
    edges of each box are cut to the other one (Liang and Barsky 1984, "A new concept and method for line clipping").
    """
    along, across = _CORNERS[0] * half_length, _CORNERS[1] * half_width
    corner_x, corner_y = ((x + along * cos - across * sin)[:, ::-1], (y + along * sin + across * cos)[:, ::-1])
    dx, dy = corner_x - x, corner_y - y  # of the corners of each as the other one sees them
    at = xp.stack([dx * cos + dy * sin, dy * cos - dx * sin])
    half = xp.stack([half_length, half_width])[:, None]
    way = xp.roll(at, -1, axis=1) - at
    way = xp.where(xp.abs(way) < _PARALLEL_M, _PARALLEL_M, way)
    low, high = (-half - at) / way, (half - at) / way
    begin = xp.maximum(xp.minimum(low, high).max(axis=0), 0.0)
    end = xp.minimum(xp.maximum(low, high).min(axis=0), 1.0)
    on_ego = (corner_x - x[0]) * cos[0] + (corner_y - y[0]) * sin[0]
    cut = on_ego + xp.stack([begin, end]) * (xp.roll(on_ego, -1, axis=0) - on_ego)
    shared = begin <= end
    least, most = xp.where(shared, cut, np.inf).min(), xp.where(shared, cut, -np.inf).max()
    return 0.5 + 0.25 * (least + most) / half_length[0]


def seen_by_ego(xp: Any, x: Any, y: Any, cos: Any, sin: Any, half_length: Any, half_width: Any) -> tuple[Any, ...]:
    """The other's centre ahead of the ego and to its left [m], and the gaps between the boxes along both axes [m].

    Each argument is a pair of the ego's and the other's values: centres and half sizes [m], cosines and sines of the
    headings.
    """
    dx, dy = x[1] - x[0], y[1] - y[0]
    turn_cos, turn_sin = xp.abs(cos[0] * cos[1] + sin[0] * sin[1]), xp.abs(cos[0] * sin[1] - sin[0] * cos[1])
    ahead, left = dx * cos[0] + dy * sin[0], dy * cos[0] - dx * sin[0]
    along = xp.abs(ahead) - half_length[0] - half_length[1] * turn_cos - half_width[1] * turn_sin
    across = xp.abs(left) - half_width[0] - half_length[1] * turn_sin - half_width[1] * turn_cos
    return ahead, left, along, across


def closes_at(xp: Any, begin_m: Any, end_m: Any) -> Any:
    """The share of a step after which a gap has closed, by its size [m] at both ends; its depth if it was closed."""
    return xp.where(begin_m > 0.0, begin_m / xp.maximum(begin_m - end_m, xp.maximum(begin_m, _PARALLEL_M)), begin_m)


def closes_in(xp: Any, side: Any, came_m: Any, swung_m: Any, dt: Any) -> Any:
    """Whether a person beside the ego closes the gap by itself, faster than one that stands.

    `side` is 1 to the ego's left and -1 to its right; over a step of `dt` [s] the person `came_m` to the left, and the
    ego's side swung `swung_m` that way.
    """
    return -side * came_m > xp.maximum(side * swung_m, STANDING_M_S * dt)
