"""How agents foresee others that come into their way: an agent lets pass whichever would be ahead of it.

An agent expects of itself the path of its log, at the speed that it can reach, and of the others that they keep their
speed and their way.
"""

import functools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from regents_cosim.geometry.boxes import same_level
from regents_cosim.geometry.frames import ahead_and_left, along_and_left
from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.lookup import look_up
from regents_cosim.mirror.reactions.bodies import Bodies, extents
from regents_cosim.mirror.reactions.following import ACCEL, FAR_M, SIDE_MARGIN_M, STILL_M_S, pressure
from regents_cosim.mirror.reactions.state import Reacting
from regents_cosim.norms.careful import FORESIGHT

_SPACING_S = 0.75
_TIMES_S = _SPACING_S * np.arange(1.0, 5.0, dtype=np.float32)
_TURNS_ON_S = 1.0
_OFF_PATH_M = 1.5  # an agent further from the path of its log has left it, or ...
_ALONG = np.float32(np.cos(FORESIGHT.along_rad))  # ... heads elsewhere


class Way(eqx.Module):
    """Where agents, or a single one, are expected to be; a row for every time ahead."""

    x: Float[Array, "sample *agent"]  # [m]
    y: Float[Array, "sample *agent"]  # [m]
    cos: Float[Array, "sample *agent"]  # of the yaw
    sin: Float[Array, "sample *agent"]
    driven: Float[Array, "sample *agent"]  # [m] since now


def own_way(log: Motion, state: Reacting, dt: Float[Array, ""]) -> Way:
    """Where agents in a `state` expect themselves on the path of their `log` [agent time], one step being `dt` [s]."""
    index, last, times_s = jnp.arange(log.x.shape[0]), log.x.shape[1] - 1, _TIMES_S[:, None]
    logged = look_up(log.speed, (index, jnp.clip(state.step, 0.0, last).astype(jnp.int32)))
    mean = jnp.minimum(state.speed + 0.5 * ACCEL * times_s, logged)
    pace = jnp.where(logged > STILL_M_S, mean / jnp.maximum(logged, STILL_M_S), 1.0)
    steps = jnp.clip(jnp.round(state.step + pace * times_s / dt), 0.0, last).astype(jnp.int32)
    x, y, yaw = (look_up(values, (index, steps)) for values in (log.x, log.y, log.yaw))
    cos, sin = jnp.cos(yaw), jnp.sin(yaw)
    return Way(x - state.left * sin, y + state.left * cos, cos, sin, mean * times_s)


def way_of_other(theirs: Bodies, turn: Float[Array, ""], log: Motion, driven: Float[Array, " time"]) -> Way:
    """Where an agent expects another one, with the single body `theirs`, that keeps its speed.

    It follows the path of its `log` [time], which is `driven` [m] long at each step. If it has left that path, it
    drives on, and turns on for a while as fast as now: `turn` [rad/s].
    """
    way_m = theirs.speed * _TIMES_S
    follows, on_path = _on_path(theirs, way_m, log, driven)
    turned = turn * jnp.minimum(_TIMES_S, _TURNS_ON_S)
    half_cos, half_sin = _turned(theirs, 0.5 * turned)
    free = theirs.x + way_m * half_cos, theirs.y + way_m * half_sin, *_turned(theirs, turned)
    expected = [jnp.where(follows, path, off) for path, off in zip(on_path, free, strict=True)]
    return Way(*expected, driven=way_m)


def _on_path(
    theirs: Bodies, way_m: Float[Array, " sample"], log: Motion, driven: Float[Array, " time"]
) -> tuple[Bool[Array, ""], tuple[Float[Array, " sample"], ...]]:
    """Whether another agent follows the path of its log, and x, y, cosine and sine of the yaw further along it.

    It keeps its distance to the path, and drives straight on where that ends.
    """
    dx, dy = theirs.x - log.x, theirs.y - log.y
    away = dx**2 + dy**2
    here = jnp.argmin(away)
    yaw = look_up(log.yaw, here)
    _, left = ahead_and_left(jnp, look_up(dx, here), look_up(dy, here), yaw)
    along, _ = ahead_and_left(jnp, theirs.cos, theirs.sin, yaw)
    follows = (look_up(away, here) < _OFF_PATH_M**2) & (along > _ALONG)
    until_m = look_up(driven, here) + way_m
    steps = jnp.minimum((driven < until_m[:, None]).sum(axis=1), len(driven) - 1)
    beyond_m, yaw = jnp.maximum(until_m - driven[-1], 0.0), look_up(log.yaw, steps)
    cos, sin = jnp.cos(yaw), jnp.sin(yaw)
    x, y = look_up(log.x, steps), look_up(log.y, steps)
    return follows, (x + beyond_m * cos - left * sin, y + beyond_m * sin + left * cos, cos, sin)


def _turned(body: Bodies, angle: Float[Array, " sample"]) -> tuple[Float[Array, " sample"], Float[Array, " sample"]]:
    """Cosine and sine of the yaw of a body that is turned by an angle [rad]."""
    cos, sin = jnp.cos(angle), jnp.sin(angle)
    return body.cos * cos - body.sin * sin, body.sin * cos + body.cos * sin


def pressure_foreseen(way: Way, other: Way, mine: Bodies, theirs: Bodies) -> Float[Array, " agent"]:
    """The interaction of each agent with another that would be ahead of it on its own way, as if that stood there now.

    `way` and `mine` are of all agents, `other` and `theirs` of the other alone. It is 0 where both would not meet.
    """
    x, y, cos, sin = (values[:, None] for values in (other.x, other.y, other.cos, other.sin))
    far, left = along_and_left(x - way.x, y - way.y, way.cos, way.sin)  # [sample agent]
    same, across = along_and_left(cos, sin, way.cos, way.sin)
    across = jnp.abs(across)
    reach, breadth = extents(jnp.abs(same), across, theirs.half_length, theirs.half_width)
    # Half of what both drive from one sample to the next.
    along_m, across_m = 0.5 * _SPACING_S * mine.speed, 0.5 * _SPACING_S * theirs.speed * across
    before = far - reach - mine.half_length
    meets = (jnp.abs(left) - breadth - across_m < mine.half_width + SIDE_MARGIN_M) & (before < along_m)
    meets &= (far > 0.0) & (mine.index != theirs.index)
    if mine.z is not None and theirs.z is not None:
        meets &= same_level(mine.z, theirs.z)
    gap, closing = jnp.where(meets, way.driven + before, FAR_M), mine.speed - theirs.speed * same
    # Sample by sample: a reduction would go value by value.
    return functools.reduce(jnp.maximum, pressure(mine.speed, gap, closing))
