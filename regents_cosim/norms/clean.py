"""Rules over arrays for what spoils a crash as a test of the planner: `xp` is NumPy or jax.numpy.

`verdicts.clean` asks them of a finished case, and `attacks.accept.acceptance` of every collision that a search comes
across.
"""

from typing import Any

import numpy as np

from regents_cosim.norms.limits import (
    ABOVE_LOG_M_S2,
    ACCEL_WINDOW_S,
    FROM_BEHIND_S,
    REAR_FACE,
    REAR_PART,
    SAME_WAY_COS,
    STANDING_M_S,
    STOOD_S,
    steps_of,
)

_CORNERS = np.array([[1, 1, -1, -1], [1, -1, -1, 1]], np.float32)[..., None]  # in their order around a box
_PARALLEL_M = 1e-6  # an edge that goes less far along an axis is parallel to the other one


def last_step(xp: Any, there: Any, step: Any) -> Any:
    """The two steps [before, at contact] that lead to `step`; the same step twice where an agent appears at it.

    `there` [time] says at which steps both agents are seen.
    """
    before = xp.maximum(step - 1, 0)
    return xp.stack([xp.where(there[before], before, step), step])


def follows(turn_cos: Any, ahead_m: Any) -> Any:
    """Whether road users drive the ego's way behind it.

    `turn_cos` is the cosine between the headings, `ahead_m` how far their centres are ahead of the ego's [m].
    """
    return (turn_cos > SAME_WAY_COS) & (ahead_m < 0.0)


def rear_ends_ego(turn_cos: Any, met_at: Any, ahead_m: Any) -> Any:
    """Whether the adversary, which `follows` at the contact, meets the rear face (`met_at`: `contact_share`)."""
    return follows(turn_cos, ahead_m) & (met_at < REAR_FACE)


def behind_since(xp: Any, there: Any, step: Any, dt: Any) -> Any:
    """The first step, at most `FROM_BEHIND_S` before `step`, at which an adversary is `there` [time]."""
    return xp.argmax(there & (xp.arange(there.shape[0]) >= step - steps_of(xp, FROM_BEHIND_S, dt)))


def comes_from_behind(met_at: Any, ahead_before_m: Any, ego_half_length: Any) -> Any:
    """Whether the adversary meets the rear part of the ego and was behind it before (`behind_since`)."""
    return (met_at < REAR_PART) & (ahead_before_m < -ego_half_length)


def harder_than(xp: Any, needed: Any, most: Any, in_log: Any) -> Any:
    """Whether accelerations [m/s^2] exceed `most`, and clearly those of the same road user's log."""
    return needed > xp.maximum(most, in_log + ABOVE_LOG_M_S2)


def hardest(xp: Any, speed: Any, yaw: Any, there: Any, dt: Any) -> Any:
    """The greatest acceleration [m/s^2] of tracks [..., time], braking and steering together; negative if none.

    The change of speed [m/s], and speed times that of the continuous `yaw` [rad], are means over windows of
    `ACCEL_WINDOW_S` in which the road user is `there`: a single step is true for the motion of a model, but in a log it
    is noise. `dt` is the step length [s].
    """
    last = speed.shape[-1] - 1
    window = xp.clip(steps_of(xp, ACCEL_WINDOW_S, dt), 1, max(last, 1))
    begin = xp.arange(last + 1)
    end = xp.minimum(begin + window, last)
    gone, absent = xp.cumsum(speed, axis=-1) - 0.5 * speed, xp.cumsum(~there, axis=-1)
    faster, turned, gone, absent = (values[..., end] - values for values in (speed, yaw, gone, absent))
    whole = there & (absent == 0) & (begin + window <= last)
    return xp.where(whole, xp.hypot(faster, gone / window * turned) / (window * dt), -1.0).max(axis=-1)


def stood(xp: Any, speed: Any, there: Any, step: Any, dt: Any) -> Any:
    """Whether a person has not moved for `STOOD_S` until `step`, by its `speed` [time] [m/s] where it is `there`."""
    now = xp.arange(there.shape[0])
    lately = there & (now <= step) & (now >= step - steps_of(xp, STOOD_S, dt))
    return ~(lately & (speed >= STANDING_M_S)).any()


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


def met_face(xp: Any, x: Any, y: Any, cos: Any, sin: Any, half_length: Any, half_width: Any) -> tuple[Any, Any]:
    """Whether the other meets a side of the ego, and whether else it meets the front instead of the rear.

    The arguments are those of `seen_by_ego`, [2, 2] at the two steps that lead to the contact (`last_step`). The motion
    between them is taken as straight in the ego's frame; the face is the one whose axis closes last. Source: the swept
    test of boxes along their axes (Ericson 2005, Real-Time Collision Detection, 5.5.8).
    """
    ahead, _, along, across = seen_by_ego(xp, x, y, cos, sin, half_length, half_width)
    return closes_at(xp, *across) > closes_at(xp, *along), ahead[0] > 0.0


def closes_in(xp: Any, x: Any, y: Any, cos: Any, sin: Any, dt: Any) -> Any:
    """Whether a person beside the ego closes the gap by itself, faster than one that stands.

    The arguments are those of `met_face`, and the step length `dt` [s]. The person must also move faster than the ego's
    side swings towards it, so one who walks beside an ego that draws nearer does not count.
    """
    cos, sin, (own_cos, own_sin) = cos[0, 0], sin[0, 0], (cos[0, 1], sin[0, 1])
    dx, dy = x[1, 0] - x[0, 0], y[1, 0] - y[0, 0]
    went, came = (y[:, 1] - y[:, 0]) * cos - (x[:, 1] - x[:, 0]) * sin  # to the left
    turned = xp.arctan2(own_sin * cos - own_cos * sin, own_cos * cos + own_sin * sin)
    side = xp.sign(dy * cos - dx * sin)
    return -side * came > xp.maximum(side * (went + turned * (dx * cos + dy * sin)), STANDING_M_S * dt)
