"""How agents foresee others that come into their way: an agent lets pass whichever would be ahead of it.

An agent expects of itself the path of its log, at the speed that it can reach, and of the others that they keep their
speed and turn on for a while. It gives way as long as it can still stop in front of the place where both would be.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from regents_cosim.geometry.boxes import same_level
from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.reactions.bodies import Bodies, extents
from regents_cosim.mirror.reactions.following import ACCEL, FAR_M, SIDE_MARGIN_M, braking_needed, pressure
from regents_cosim.mirror.reactions.state import Reacting
from regents_cosim.norms.limits import ACCEL_LIMIT

_SPACING_S = 0.75
_TIMES_S = _SPACING_S * np.arange(1.0, 5.0, dtype=np.float32)
_TURNS_ON_S = 1.0
_STANDING_M_S = 0.05


class OwnWay(eqx.Module):
    """Where agents expect themselves to be."""

    x: Float[Array, "agent sample"]  # [m]
    y: Float[Array, "agent sample"]  # [m]
    cos: Float[Array, "agent sample"]  # of the yaw
    sin: Float[Array, "agent sample"]
    driven: Float[Array, "agent sample"]  # [m] since now


def own_way(log: Motion, state: Reacting, dt: Float[Array, ""]) -> OwnWay:
    """Where agents in a `state` expect themselves on the path of their `log` [agent time], one step being `dt` [s]."""
    index, last = jnp.arange(log.x.shape[0]), log.x.shape[1] - 1
    logged = log.speed[index, jnp.clip(state.step, 0.0, last).astype(jnp.int32)][:, None]
    mean = jnp.minimum(state.speed[:, None] + 0.5 * ACCEL * _TIMES_S, logged)
    pace = jnp.where(logged > _STANDING_M_S, mean / jnp.maximum(logged, _STANDING_M_S), 1.0)
    steps = jnp.clip(jnp.round(state.step[:, None] + pace * _TIMES_S / dt), 0.0, last).astype(jnp.int32)
    x, y, yaw = (values[index[:, None], steps] for values in (log.x, log.y, log.yaw))
    cos, sin, left = jnp.cos(yaw), jnp.sin(yaw), state.left[:, None]
    return OwnWay(x - left * sin, y + left * cos, cos, sin, mean * _TIMES_S)


def pressure_foreseen(
    way: OwnWay, mine: Bodies, theirs: Bodies, turn: Float[Array, " other"]
) -> Float[Array, "agent other"]:
    """The interaction of an agent with each other that would be ahead of it on its own way, as if that stood there now.

    It is 0 where both would not meet, or where the agent cannot stop any more. `turn` [rad/s] is how fast the others
    turn.
    """
    turned = turn[:, None] * jnp.minimum(_TIMES_S, _TURNS_ON_S)
    middle, end = (jnp.cos(part * turned) for part in (0.5, 1.0)), (jnp.sin(part * turned) for part in (0.5, 1.0))
    (half_cos, full_cos), (half_sin, full_sin) = middle, end
    way_m = theirs.speed[:, None] * _TIMES_S
    x = theirs.x[:, None] + way_m * (theirs.cos[:, None] * half_cos - theirs.sin[:, None] * half_sin)
    y = theirs.y[:, None] + way_m * (theirs.sin[:, None] * half_cos + theirs.cos[:, None] * half_sin)
    cos = theirs.cos[:, None] * full_cos - theirs.sin[:, None] * full_sin
    sin = theirs.sin[:, None] * full_cos + theirs.cos[:, None] * full_sin

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
    meets &= (gap > 0.0) & (braking_needed(gap, closing) < ACCEL_LIMIT)
    meets &= (mine.index[:, None] != theirs.index[None])[..., None]
    if mine.z is not None and theirs.z is not None:
        meets &= same_level(mine.z[:, None], theirs.z[None])[..., None]
    return pressure(mine.speed[:, None, None], jnp.where(meets, gap, FAR_M), closing).max(axis=-1)
