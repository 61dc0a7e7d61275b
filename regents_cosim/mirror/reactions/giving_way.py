"""How agents foresee others that come into their way: an agent lets pass whichever would be ahead of it.

An agent expects of itself the path of its log, at the speed that it can reach, and of the others that they keep their
speed and their way.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.geometry.boxes import same_level
from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.reactions.bodies import Bodies, extents
from regents_cosim.mirror.reactions.following import ACCEL, FAR_M, SIDE_MARGIN_M, pressure
from regents_cosim.mirror.reactions.state import Reacting
from regents_cosim.norms.careful import FORESIGHT

_SPACING_S = 0.75
_TIMES_S = _SPACING_S * np.arange(1.0, 5.0, dtype=np.float32)
_TURNS_ON_S = 1.0
_OFF_PATH_M = 1.5  # an agent further from the path of its log has left it, or ...
_ALONG = np.float32(np.cos(FORESIGHT.along_rad))  # ... heads elsewhere
_STANDING_M_S = 0.05


class Way(eqx.Module):
    """Where agents are expected to be."""

    x: Float[Array, "agent sample"]  # [m]
    y: Float[Array, "agent sample"]  # [m]
    cos: Float[Array, "agent sample"]  # of the yaw
    sin: Float[Array, "agent sample"]
    driven: Float[Array, "agent sample"]  # [m] since now


def own_way(log: Motion, state: Reacting, dt: Float[Array, ""]) -> Way:
    """Where agents in a `state` expect themselves on the path of their `log` [agent time], one step being `dt` [s]."""
    index, last = jnp.arange(log.x.shape[0]), log.x.shape[1] - 1
    logged = log.speed[index, jnp.clip(state.step, 0.0, last).astype(jnp.int32)][:, None]
    mean = jnp.minimum(state.speed[:, None] + 0.5 * ACCEL * _TIMES_S, logged)
    pace = jnp.where(logged > _STANDING_M_S, mean / jnp.maximum(logged, _STANDING_M_S), 1.0)
    steps = jnp.clip(jnp.round(state.step[:, None] + pace * _TIMES_S / dt), 0.0, last).astype(jnp.int32)
    x, y, yaw = (values[index[:, None], steps] for values in (log.x, log.y, log.yaw))
    cos, sin, left = jnp.cos(yaw), jnp.sin(yaw), state.left[:, None]
    return Way(x - left * sin, y + left * cos, cos, sin, mean * _TIMES_S)


def ways_of_others(
    theirs: Bodies, turn: Float[Array, " other"], log: Motion, driven: Float[Array, "other time"]
) -> Way:
    """Where an agent expects others to be that keep their speed.

    Each follows the path of its `log` [other time], which is `driven` [m] long at each step. One that has left that
    path drives on, and turns on for a while as fast as now: `turn` [rad/s].
    """
    way_m = theirs.speed[:, None] * _TIMES_S
    follows, on_path = _on_path(theirs, way_m, log, driven)
    turned = turn[:, None] * jnp.minimum(_TIMES_S, _TURNS_ON_S)
    half_cos, half_sin = _turned(theirs, 0.5 * turned)
    free = theirs.x[:, None] + way_m * half_cos, theirs.y[:, None] + way_m * half_sin, *_turned(theirs, turned)
    return Way(*(jnp.where(follows, path, off) for path, off in zip(on_path, free, strict=True)), driven=way_m)


def _on_path(
    theirs: Bodies, way_m: Float[Array, "other sample"], log: Motion, driven: Float[Array, "other time"]
) -> tuple[Bool[Array, "other 1"], tuple[Float[Array, "other sample"], ...]]:
    """Whether others follow the path of their log, and x, y, cosine and sine of the yaw further along it.

    They keep their distance to the path, and drive straight on where it ends.
    """

    def at(values: Float[Array, "other time"], step: Int[Array, "other steps"]) -> Float[Array, "other steps"]:
        return jnp.take_along_axis(values, step, axis=1)

    dx, dy = theirs.x[:, None] - log.x, theirs.y[:, None] - log.y
    away = dx**2 + dy**2
    here = jnp.argmin(away, axis=1, keepdims=True)
    yaw = at(log.yaw, here)
    left = at(dy, here) * jnp.cos(yaw) - at(dx, here) * jnp.sin(yaw)
    along = theirs.cos[:, None] * jnp.cos(yaw) + theirs.sin[:, None] * jnp.sin(yaw)
    follows = (at(away, here) < _OFF_PATH_M**2) & (along > _ALONG)
    until_m = at(driven, here) + way_m
    steps = jnp.minimum((driven[:, None] < until_m[..., None]).sum(axis=2), driven.shape[1] - 1)
    beyond_m, yaw = jnp.maximum(until_m - driven[:, -1:], 0.0), at(log.yaw, steps)
    cos, sin = jnp.cos(yaw), jnp.sin(yaw)
    return follows, (
        at(log.x, steps) + beyond_m * cos - left * sin,
        at(log.y, steps) + beyond_m * sin + left * cos,
        cos,
        sin,
    )


def _turned(
    body: Bodies, angle: Float[Array, "other sample"]
) -> tuple[Float[Array, "other sample"], Float[Array, "other sample"]]:
    """Cosine and sine of the yaw of bodies that are turned by an angle [rad]."""
    cos, sin = jnp.cos(angle), jnp.sin(angle)
    return body.cos[:, None] * cos - body.sin[:, None] * sin, body.sin[:, None] * cos + body.cos[:, None] * sin


def pressure_foreseen(way: Way, others: Way, mine: Bodies, theirs: Bodies) -> Float[Array, "agent other"]:
    """The interaction of an agent with each other that would be ahead of it on its own way, as if that stood there now.

    It is 0 where both would not meet.
    """
    x, y, cos, sin = others.x, others.y, others.cos, others.sin
    dx, dy = x[None] - way.x[:, None], y[None] - way.y[:, None]  # [agent other sample]
    own_cos, own_sin = way.cos[:, None], way.sin[:, None]
    far, left = dx * own_cos + dy * own_sin, dy * own_cos - dx * own_sin
    same, across = own_cos * cos[None] + own_sin * sin[None], own_cos * sin[None] - own_sin * cos[None]
    reach, breadth = extents(
        jnp.abs(same), jnp.abs(across), theirs.half_length[None, :, None], theirs.half_width[None, :, None]
    )
    half_length, half_width = mine.half_length[:, None, None], mine.half_width[:, None, None]
    # Half of what both drive from one sample to the next.
    along_m = 0.5 * _SPACING_S * mine.speed[:, None, None]
    across_m = 0.5 * _SPACING_S * theirs.speed[None, :, None] * jnp.abs(across)
    meets = (jnp.abs(left) - breadth - across_m < half_width + SIDE_MARGIN_M) & (far - reach - half_length < along_m)
    meets &= far > 0.0
    gap = way.driven[:, None] + far - reach - half_length
    closing = mine.speed[:, None, None] - theirs.speed[None, :, None] * same
    meets &= (mine.index[:, None] != theirs.index[None])[..., None]
    if mine.z is not None and theirs.z is not None:
        meets &= same_level(mine.z[:, None], theirs.z[None])[..., None]
    return pressure(mine.speed[:, None, None], jnp.where(meets, gap, FAR_M), closing).max(axis=-1)
