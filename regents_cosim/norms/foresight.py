"""The motion that a careful driver expects of others, and the road users that it suspects of a collision.

The driver expects the others to go on with their present speed and turn, and the ego along its own path. It expects
the ego, and a leader in its way, to brake on as they do until they stand; to expect that of crossing traffic would be
careless. A risk is an overlap of the two within some seconds; within fewer where a road user runs the ego's way and
does not brake hard, since leaders and cut-ins are no danger until they are near. The driver suspects those that cross,
those in the way that the ego is about to sweep, and those beside it that drift from the middle of the next lane towards
its way, or into whose lane the ego is about to come over. It expects a road user that keeps to its lane to go on doing
so, one that changes lanes to end in the next one, and one that has to let it pass to wait at its line (if it turns on
green, before the ego's lane), as long as comfortable braking is enough for that.

Every function is written for NumPy and JAX: `xp` is the array module, and arrays broadcast.

Source of the wandering zone: UN Regulation 157, Annex 3 (01 series), performance models: a lane change into the ego's
lane is perceived when a vehicle's centre is more than 0.375 m from the middle of the next lane. The rest generalises
the regulation's cut-in, cut-out and deceleration from a lane to any road.
"""

from typing import Any, NamedTuple

import numpy as np

from regents_cosim.norms.careful import CAREFUL, FORESIGHT
from regents_cosim.norms.following import can_stop
from regents_cosim.norms.limits import CURVATURE_LIMIT

_LEAST_TRAVEL_M = 0.05  # below, a turn is noise
_BESIDE_A_LANE_M = 4.0  # further away there is no lane
_NEXT_LANE_M = 5.25  # one and a half lanes: road users further from the ego's path are not in the lane next to it
_ALONG, _AGAINST = (np.float32(np.cos(angle)) for angle in (FORESIGHT.along_rad, FORESIGHT.against_rad))


class PlaceOnPath(NamedTuple):
    """Places of road users relative to the ego's path; boolean arrays of one shape."""

    ahead: Any  # the centre lies ahead of the ego's
    in_way: Any  # and the body reaches into what the ego will sweep
    beside: Any  # it is neither wholly ahead nor wholly behind
    leads: Any  # and it runs the ego's way
    aside_m: Any  # of the centre to the left of the path; an array of numbers [m], as the next
    turn_cos: Any  # cosine of the angle between the directions of the path and of the road user


def curvature_of(xp: Any, turned: Any, speed: Any, passed_s: Any) -> Any:
    """Curvature [1/m] of road users that have `turned` [rad] in `passed_s` at `speed` [m/s]; no car turns tighter."""
    moved = speed * passed_s
    curvature = xp.where(moved > _LEAST_TRAVEL_M, turned / xp.maximum(moved, _LEAST_TRAVEL_M), 0.0)
    return xp.clip(curvature, -CURVATURE_LIMIT, CURVATURE_LIMIT)


def motion_over(xp: Any, turned: Any, lost: Any, speed: Any, known: Any, passed_s: Any) -> tuple[Any, Any]:
    """Curvature [1/m] and braking [m/s^2] of road users over the last `passed_s`; both 0 where they are not `known`.

    They have `turned` [rad] and `lost` speed [m/s] meanwhile (negative where they gained some), and go at `speed` now.
    """
    curvature = curvature_of(xp, xp.where(known, turned, 0.0), speed, passed_s)
    return curvature, xp.where(known, xp.maximum(lost, 0.0) / passed_s, 0.0)


def further(xp: Any, speed: Any, braking: Any, time: Any) -> Any:
    """Distance [m] driven in `time` [s] from `speed` [m/s], with `braking` [m/s^2] until standstill."""
    until = xp.minimum(time, speed / xp.maximum(braking, 1e-6))
    return (speed - 0.5 * braking * until) * until


def along_arc(xp: Any, x: Any, y: Any, yaw: Any, turn: Any, distance: Any) -> tuple[Any, Any, Any]:
    """X, y [m] and yaw [rad] after `distance` [m] along an arc that turns evenly by `turn` [rad]."""
    half_turn = 0.5 * turn
    chord = distance * xp.sinc(half_turn / np.pi)
    return x + chord * xp.cos(yaw + half_turn), y + chord * xp.sin(yaw + half_turn), yaw + turn


def breadth(xp: Any, turn: Any, half_length: Any, half_width: Any) -> Any:
    """Half the width [m] across the ego's way of bodies that are turned by `turn` [rad] from it."""
    return xp.abs(xp.sin(turn)) * half_length + xp.abs(xp.cos(turn)) * half_width


def place_of(
    xp: Any, ahead_m: Any, aside_m: Any, turn: Any, half_length: Any, half_width: Any, ego_half: tuple[Any, Any]
) -> PlaceOnPath:
    """The place of road users whose centres are `ahead_m` of the ego's along its path and `aside_m` of it [m].

    `ego_half` has half the length and half the width of the ego [m].
    """
    ahead = ahead_m > 0.0
    in_way = ahead & (xp.abs(aside_m) - breadth(xp, turn, half_length, half_width) < ego_half[1])
    beside = xp.abs(ahead_m) < half_length + ego_half[0]
    turn_cos = xp.cos(turn)
    return PlaceOnPath(ahead, in_way, beside, in_way & (turn_cos > _ALONG), aside_m, turn_cos)


def drifts(xp: Any, off_m: Any, place: PlaceOnPath) -> Any:
    """Whether road users have left the middle of their lane for the ego's way.

    `off_m` [m] is how far to its left they are of the nearest centre line that runs their way; infinite or very large
    where there is none, so that any of them may. Those that run the ego's way drift from the next lane towards its
    path; those in the way, and oncoming ones, whose turns cross it, may be on either side of their line.
    """
    towards = (xp.sign(off_m) * xp.sign(place.aside_m) < 0.0) & (xp.abs(place.aside_m) < _NEXT_LANE_M)
    off = xp.abs(off_m)
    either = place.in_way | (place.turn_cos < 0.0) | (off > _BESIDE_A_LANE_M)
    return (off > CAREFUL.wandering_m) & (towards | either)


def between_lanes(away_m: Any) -> Any:
    """Whether an ego is on its way from a lane to another: `away_m` from the nearest centre line in its direction [m].

    Where no lane runs its way it has none to change.
    """
    return (away_m > CAREFUL.wandering_m) & (away_m < _BESIDE_A_LANE_M)


def comes_over(between: Any, along: Any, here: Any, reach: Any) -> Any:
    """Whether an ego is about to leave the middle of its lane for another.

    `between` tells for places of its path, `along` it by way or time, whether it is `between_lanes` there; it is `here`
    now, and what a driver foresees ends at `reach`. `here` and `reach` are numbers or arrays of one shape.
    """
    ahead = (along >= here[..., None]) & (along <= reach[..., None])
    return (between & ahead).any(axis=-1)


def crosses(turn_cos: Any) -> Any:
    """Whether a road user crosses the ego's way: it runs neither along it nor against it."""
    return (turn_cos <= _ALONG) & (turn_cos >= _AGAINST)


def can_wait(line_m: Any, half_length: Any, speed: Any) -> Any:
    """Whether road users whose centres are `line_m` from their lines [m] (0: none) can still stop there comfortably."""
    return can_stop(speed, line_m - half_length, CAREFUL.comfortable_m_s2)


def is_suspected(
    xp: Any,
    place: PlaceOnPath,
    meets_s: Any,
    turn_cos: Any,
    wanders: Any,
    waits: Any,
    braking: Any,
    comes_over: Any,
) -> Any:
    """Whether a meeting in `meets_s` seconds (infinite: none) is expected of road users.

    `turn_cos` is the cosine of the turn between the two when they would meet; `wanders` tells who has left the middle
    of its lane for the ego's way (`drifts`), `waits` who has to let the ego pass and still can (`can_wait`); `braking`
    [m/s^2] is what each does now. `comes_over` tells whether the ego is about to leave the middle of its lane for
    another (`comes_over`): a road user beside it there goes first. Any other road user that runs the ego's way and does
    not brake hard is a danger only `lead_s` before the meeting (UN R157, performance models, cut-in).
    """
    same_way = turn_cos > _ALONG
    joined = comes_over & place.beside & same_way
    calm = same_way & ~joined & (braking <= CAREFUL.lead_braking_m_s2)
    soon = meets_s <= xp.where(calm, FORESIGHT.lead_s, FORESIGHT.ahead_s)
    comes = place.in_way | joined | xp.where(crosses(turn_cos), ~waits, wanders)
    return soon & comes & (place.ahead | joined | ~same_way)
