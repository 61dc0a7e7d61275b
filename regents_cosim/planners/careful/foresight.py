"""What a careful driver sees coming (`norms.foresight`), on the device."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.separation import Box, overlaps
from regents_cosim.norms.careful import FORESIGHT
from regents_cosim.norms.foresight import PlaceOnPath, along_arc, can_wait, drifts, further, is_suspected, motion_over

_TIMES = len(FORESIGHT.times_s)
_TIMES_S = FORESIGHT.times_s.astype(np.float32)
EGO_TIMES_S = FORESIGHT.ego_times_s.astype(np.float32)  # instants at which `is_risk` needs the ego
_SLACK = FORESIGHT.slack
_SHIFTED = np.arange(_TIMES)[:, None] + np.arange(-_SLACK, _SLACK + 1)  # the ego's instants for each of the others'
_EGO_AT, _EVER = np.maximum(_SHIFTED, 0), _SHIFTED >= 0


class ExpectedMotion(eqx.Module):
    """The present motion of agents, which they are expected to keep up."""

    x: Float[Array, "*axes"]  # [m]
    y: Float[Array, "*axes"]  # [m]
    yaw: Float[Array, "*axes"]  # [rad]
    speed: Float[Array, "*axes"]  # [m/s]
    curvature: Float[Array, "*axes"]  # [1/m]
    braking: Float[Array, "*axes"]  # [m/s^2] 0 for agents that gain speed
    half_length: Float[Array, "*#axes"]  # [m]
    half_width: Float[Array, "*#axes"]  # [m]
    z: Float[Array, "*axes"] | None = None  # [m]

    @classmethod
    def since(
        cls,
        before: tuple[Float[Array, " agent"], Float[Array, " agent"]],
        now: Motion,
        known: Bool[Array, " agent"],
        passed_s: Float[Array, ""] | Float[Array, " agent"],
        sizes: tuple[Float[Array, " #agent"], Float[Array, " #agent"]],
    ) -> "ExpectedMotion":
        """The motion of agents that had the yaw and the speed `before`, `passed_s` ago; straight on where not `known`.

        `sizes` are half their length and width [m].
        """
        yaw, speed = before
        over = motion_over(jnp, now.yaw - yaw, speed - now.speed, now.speed, known, passed_s)
        return cls(now.x, now.y, now.yaw, now.speed, *over, *sizes)


def is_risk(
    ego: Box,
    course: ExpectedMotion,
    place: PlaceOnPath,
    off_m: Float[Array, "*axes"],
    line_m: Float[Array, "*axes"],
    comes_over: Bool[Array, "*#axes"],
) -> Bool[Array, "*axes"]:
    """Which agents are suspected of a meeting with the ego, given `ego` [*axes time] at `EGO_TIMES_S` from now.

    `off_m` is how far each is to the left of the nearest centre line in its direction (`norms.foresight.drifts`),
    `line_m` its distance [m] to a line where it has to let the ego pass; 0: none. `comes_over` tells whether the ego is
    about to change lanes.
    """
    hit, cos = _meetings(ego, _going_on(course, place.leads))
    meets_s = jnp.where(hit.any(axis=-1), FORESIGHT.spacing_s * (jnp.argmax(hit, axis=-1) // (2 * _SLACK + 1)), jnp.inf)
    first = hit & jnp.equal(jnp.cumsum(hit, axis=-1), 1)
    turn = jnp.where(first, cos, 0.0).sum(axis=-1)  # cosine of that between the two when they would meet
    waits = can_wait(line_m, course.half_length, course.speed)
    return is_suspected(jnp, place, meets_s, turn, drifts(jnp, off_m, place), waits, course.braking, comes_over)


def _going_on(course: ExpectedMotion, leads: Bool[Array, "*axes"]) -> Box:
    """The expected boxes of agents [*axes time]; an agent that leads continues to brake."""
    braking = jnp.where(leads, course.braking, 0.0)[..., None]
    way = further(jnp, course.speed[..., None], braking, _TIMES_S)
    x, y, yaw, curvature = (values[..., None] for values in (course.x, course.y, course.yaw, course.curvature))
    x, y, yaw = along_arc(jnp, x, y, yaw, curvature * way, way)
    size = course.half_length[..., None], course.half_width[..., None]
    return Box(x, y, jnp.cos(yaw), jnp.sin(yaw), *size, None if course.z is None else course.z[..., None])


def may_meet(ego: Box, other: Box) -> Bool[Array, "*axes time"]:
    """Whether agents would touch the ego at each time of `other`, if it were early or late by up to the slack."""
    mine, theirs = _by_slack(ego, other)
    return (overlaps(mine, theirs) & _EVER).any(axis=-1)


def _meetings(ego: Box, other: Box) -> tuple[Bool[Array, "*axes meeting"], Float[Array, "*axes meeting"]]:
    """Whether they overlap, by time and slack, and the cosine of the angle between them."""
    mine, theirs = _by_slack(ego, other)
    hit = overlaps(mine, theirs) & _EVER
    turn = mine.cos * theirs.cos + mine.sin * theirs.sin
    return hit.reshape(*hit.shape[:-2], -1), turn.reshape(*turn.shape[:-2], -1)


def _by_slack(ego: Box, other: Box) -> tuple[Box, Box]:
    """Both boxes [*axes time slack] at each of the times of `other`, with the ego early and late by up to the slack."""
    mine = jax.tree.map(lambda values: values[..., _EGO_AT] if values.ndim else values, ego)
    return mine, jax.tree.map(lambda values: values[..., None], other)
