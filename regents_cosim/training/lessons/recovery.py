"""The expert for any state: it returns to where its log has it, in place and in time.

The expert knows the log. It steers by pure pursuit on the logged path and accelerates like a critically damped spring
between itself and its logged position. On its log it continues like the log, so its waypoints are the logged ones
except where it cuts curves.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from regents_cosim.mirror.bicycle import ControlArrays, Motion, clip, step
from regents_cosim.planners.aim_bev.architecture import WAYPOINTS

_SPRING = 0.25  # [1/s^2] per metre behind the log
_DAMPER = 1.0  # [1/s] per m/s slower than the log; 2 sqrt(spring) is critical damping
_MOST_ACCEL, _MOST_BRAKE = 3.0, 6.0  # [m/s^2]
_LOOK_AHEAD_S, _LEAST_LOOK_AHEAD_M = 0.5, 3.0  # of pure pursuit


def expert_waypoints(
    log: Motion, last: Int[Array, ""], now: Int[Array, ""], ego: Motion, dt: Float[Array, ""] | float
) -> Float[Array, "waypoint 2"]:
    """Waypoints [m, frame of `ego`] from the state `ego` at step `now` of its `log` [time], which ends at `last`."""
    along = jnp.concatenate([jnp.zeros(1), jnp.cumsum(jnp.hypot(jnp.diff(log.x), jnp.diff(log.y)))])

    def advance(state: Motion, ahead: Array) -> tuple[Motion, Motion]:
        after = step(state, _controls(log, along, last, now + ahead, state, dt), dt)
        return after, after

    _, way = jax.lax.scan(advance, ego, jnp.arange(WAYPOINTS))
    dx, dy, cos, sin = way.x - ego.x, way.y - ego.y, jnp.cos(ego.yaw), jnp.sin(ego.yaw)
    return jnp.stack([dx * cos + dy * sin, dy * cos - dx * sin], axis=-1)


def _controls(log: Motion, along: Array, last: Array, now: Array, ego: Motion, dt: Array | float) -> ControlArrays:
    steps = jnp.arange(log.x.shape[0])
    away = jnp.where(steps <= last, jnp.hypot(log.x - ego.x, log.y - ego.y), jnp.inf)
    nearest = jnp.argmin(away)
    cos, sin = jnp.cos(log.yaw[nearest]), jnp.sin(log.yaw[nearest])
    here = along[nearest] + (ego.x - log.x[nearest]) * cos + (ego.y - log.y[nearest]) * sin
    before, after = jnp.minimum(now, last - 1), jnp.minimum(now + 1, last)
    planned = (log.speed[after] - log.speed[before]) / dt
    accel = planned + _SPRING * (along[before] - here) + _DAMPER * (log.speed[before] - ego.speed)
    wanted = here + jnp.maximum(_LOOK_AHEAD_S * ego.speed, _LEAST_LOOK_AHEAD_M)
    beyond = jnp.maximum(wanted - along[last], 0.0)  # straight on where the log ends
    x = _at(wanted, along, log.x, last) + beyond * jnp.cos(log.yaw[last]) - ego.x
    y = _at(wanted, along, log.y, last) + beyond * jnp.sin(log.yaw[last]) - ego.y
    left = y * jnp.cos(ego.yaw) - x * jnp.sin(ego.yaw)
    accel = jnp.clip(accel, -_MOST_BRAKE, _MOST_ACCEL)
    return clip(ControlArrays(accel, 2.0 * left / jnp.maximum(x**2 + y**2, 1.0)))


def _at(wanted: Array, along: Array, values: Array, last: Array) -> Float[Array, ""]:
    """`values` at the distance `wanted` [m] along the log; the last one beyond its end."""
    after = jnp.clip(jnp.searchsorted(along, wanted, side="right"), 1, last)
    part = (wanted - along[after - 1]) / jnp.maximum(along[after] - along[after - 1], 1e-6)
    return values[after - 1] + jnp.clip(part, 0.0, 1.0) * (values[after] - values[after - 1])
