"""What a careful driver sees coming, on the device: of several agents at one instant, or of one at many.

The same rules as `regents_cosim.verdicts.foresight` on the host, which has their sources.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from regents_cosim.mirror.bicycle import CURVATURE_LIMIT
from regents_cosim.mirror.separation import Box, overlaps
from regents_cosim.planners.reference.parameters import CAREFUL, FORESIGHT

_TIMES = len(FORESIGHT.times_s)
_TIMES_S = FORESIGHT.times_s.astype(np.float32)
EGO_TIMES_S = FORESIGHT.ego_times_s.astype(np.float32)  # at which `is_risk` wants to know where the ego would be
_SLACK = FORESIGHT.slack
_SHIFTED = np.arange(_TIMES)[:, None] + np.arange(-_SLACK, _SLACK + 1)  # the ego's instants for each of the others'
_EGO_AT, _EVER = np.maximum(_SHIFTED, 0), _SHIFTED >= 0
_ALONG = np.float32(np.cos(FORESIGHT.along_rad))
_AGAINST = np.float32(np.cos(FORESIGHT.against_rad))
_LEAST_TRAVEL_M = 0.05  # below, a turn is noise


class ExpectedMotion(eqx.Module):
    """How agents move now, and what they are expected to keep up."""

    x: Float[Array, "*axes"]  # [m]
    y: Float[Array, "*axes"]  # [m]
    yaw: Float[Array, "*axes"]  # [rad]
    speed: Float[Array, "*axes"]  # [m/s]
    curvature: Float[Array, "*axes"]  # [1/m]
    braking: Float[Array, "*axes"]  # [m/s^2] 0 for those that gain speed
    half_length: Float[Array, "*#axes"]  # [m]
    half_width: Float[Array, "*#axes"]  # [m]
    z: Float[Array, "*axes"] | None = None  # [m]


def curvature_of(turned: Array, speed: Array, passed_s: Array) -> Array:
    """Curvature [1/m] of those who have turned so far [rad] in some time at a speed [m/s]."""
    moved = speed * passed_s
    curvature = jnp.where(moved > _LEAST_TRAVEL_M, turned / jnp.maximum(moved, _LEAST_TRAVEL_M), 0.0)
    return jnp.clip(curvature, -CURVATURE_LIMIT, CURVATURE_LIMIT)


def further(speed: Array, braking: Array, time: Array | np.ndarray) -> Array:
    """How far one comes [m] in some time with a speed, braking until one stands."""
    until = jnp.minimum(time, speed / jnp.maximum(braking, 1e-6))
    return (speed - 0.5 * braking * until) * until


class PlaceOnPath(eqx.Module):
    """Where agents are as seen from the ego's path."""

    ahead: Bool[Array, "*axes"]  # their centres, of the ego's
    in_way: Bool[Array, "*axes"]  # and they reach into what the ego will sweep
    leads: Bool[Array, "*axes"]  # and run its way


def breadth(turn: Array, half_length: Array, half_width: Array) -> Array:
    """How far bodies reach to either side of their centres [m], turned off the ego's way by so much [rad]."""
    return jnp.abs(jnp.sin(turn)) * half_length + jnp.abs(jnp.cos(turn)) * half_width


def place_of(course: ExpectedMotion, ahead_m: Array, aside_m: Array, turn: Array, ego_half_width: Array) -> PlaceOnPath:
    """That of agents whose centres are so far ahead of the ego's along its path, and aside of it."""
    ahead = ahead_m > 0.0
    reach = breadth(turn, course.half_length, course.half_width)
    in_way = ahead & (jnp.abs(aside_m) - reach < ego_half_width)
    return PlaceOnPath(ahead, in_way, in_way & (jnp.cos(turn) > _ALONG))


def is_risk(
    ego: Box, course: ExpectedMotion, place: PlaceOnPath, wanders: Bool[Array, "*axes"]
) -> Bool[Array, "*axes"]:
    """Who is expected to meet the ego, and is suspected of it. `ego` [*axes time] at `EGO_TIMES_S` from now.

    `wanders`: they have left the middle of every lane that runs their way.
    """
    hit, cos = _meetings(ego, _going_on(course, place.leads))
    meets_s = jnp.where(hit.any(axis=-1), FORESIGHT.spacing_s * (jnp.argmax(hit, axis=-1) // (2 * _SLACK + 1)), jnp.inf)
    first = hit & jnp.equal(jnp.cumsum(hit, axis=-1), 1)
    turn = jnp.where(first, cos, 0.0).sum(axis=-1)  # cosine of that between the two when they would meet
    same_way = turn > _ALONG
    crosses = ~same_way & (turn >= _AGAINST)
    keeps_ahead = place.in_way & same_way & ~wanders
    ahead_s = jnp.where(course.braking > CAREFUL.lead_braking_m_s2, FORESIGHT.ahead_s, FORESIGHT.lead_s)
    suspected = jnp.where(keeps_ahead, meets_s <= ahead_s, crosses | place.in_way | wanders)
    return jnp.isfinite(meets_s) & suspected & (place.ahead | ~same_way)


def _going_on(course: ExpectedMotion, leads: Bool[Array, "*axes"]) -> Box:
    """Where agents are expected [*axes time]; who leads brakes on, too."""
    way = further(course.speed[..., None], jnp.where(leads, course.braking, 0.0)[..., None], _TIMES_S)
    half_turn = 0.5 * course.curvature[..., None] * way
    chord = way * jnp.sinc(half_turn / np.pi)
    yaw = course.yaw[..., None]
    size = course.half_length[..., None], course.half_width[..., None]
    return Box(
        course.x[..., None] + chord * jnp.cos(yaw + half_turn),
        course.y[..., None] + chord * jnp.sin(yaw + half_turn),
        jnp.cos(yaw + 2.0 * half_turn),
        jnp.sin(yaw + 2.0 * half_turn),
        *size,
        None if course.z is None else course.z[..., None],
    )


def may_meet(ego: Box, other: Box) -> Bool[Array, "*axes time"]:
    """Whether they would touch, at each of the times of `other`, were the ego earlier or later by up to the slack."""
    mine, theirs = _by_slack(ego, other)
    return (overlaps(mine, theirs) & _EVER).any(axis=-1)


def _meetings(ego: Box, other: Box) -> tuple[Bool[Array, "*axes meeting"], Float[Array, "*axes meeting"]]:
    """Whether they overlap, by time and slack, and the cosine of the turn between them."""
    mine, theirs = _by_slack(ego, other)
    hit = overlaps(mine, theirs) & _EVER
    turn = mine.cos * theirs.cos + mine.sin * theirs.sin
    return hit.reshape(*hit.shape[:-2], -1), turn.reshape(*turn.shape[:-2], -1)


def _by_slack(ego: Box, other: Box) -> tuple[Box, Box]:
    """Both [*axes time slack] at each of the times of `other`, the ego earlier and later by up to the slack."""
    mine = jax.tree.map(lambda values: values[..., _EGO_AT] if values.ndim else values, ego)
    return mine, jax.tree.map(lambda values: values[..., None], other)
