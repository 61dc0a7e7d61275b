"""Background agents that keep to their recorded path but brake for obstacles on it.

An agent that merely replays its log runs into an ego or an adversary that brakes where the log did not, and no driver
is to blame for that crash. A reacting agent follows its logged path at its logged speed or slower: its state is its
progress in its own log. It brakes by the interaction term of the Intelligent Driver Model (Treiber, Hennecke and
Helbing 2000),

    a (1 - (s* / s)^2) where s < s*,   s* = s0 + max(0, v T + v dv / (2 sqrt(a b))),

only for agents that have left their log; so undisturbed traffic stays exactly as recorded. No gradient passes through
reactions.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.geometry.boxes import same_level
from regents_cosim.mirror.bicycle import Motion
from regents_cosim.norms.limits import ACCEL_LIMIT

_HEADWAY_S = 0.5
_STANDSTILL_M = 1.0
_ACCEL = 2.0  # [m/s^2]
_BRAKE = 4.0  # [m/s^2] comfortable
_SIDE_MARGIN_M = 0.2
_OFF_LOG_M = 0.3  # an agent further from its logged position counts as disturbed
_FAR_M = 1e3
_STRAIGHT = 1e-4  # [1/m] smaller curvatures count as straight
_STANDING_M_S = 0.05
_CONTACT_M = 0.1  # smaller gaps count as this
_AT_A_TIME = 4  # disturbed agents handled at once


class LogProgress(eqx.Module):
    """The progress of agents in their own logs."""

    step: Float[Array, " agent"]  # of the log, at most the present step
    speed: Float[Array, " agent"]  # [m/s]


def begin(log: Motion) -> LogProgress:
    """The progress of agents at the begin of their logs."""
    return LogProgress(jnp.zeros_like(log.speed[:, 0]), log.speed[:, 0])


def place(log: Motion, progress: LogProgress) -> Motion:
    """Poses [agent] of agents at `progress` in `log` [agent, time]."""
    x, y, yaw = (_at(values, log, progress.step) for values in (log.x, log.y, log.yaw))
    return Motion(x, y, yaw, progress.speed)


def react(
    progress: LogProgress,
    now: Motion,
    log: Motion,
    curvature: Float[Array, "agent step"],
    log_now: Motion,
    present: Bool[Array, " agent"],
    half_length: Float[Array, " agent"],
    half_width: Float[Array, " agent"],
    dt: Float[Array, ""],
    z: Float[Array, " agent"] | None = None,
) -> LogProgress:
    """The progress one step of `dt` [s] later; agents are at `now` [agent], and in the log at `log_now` [agent].

    `z` [m] are the heights of their roads, in scenes with roads above each other.
    """
    disturbed = present & (jnp.hypot(now.x - log_now.x, now.y - log_now.y) > _OFF_LOG_M)
    before, _, _ = _neighbours(log, progress.step)
    bend = jnp.take_along_axis(curvature, jnp.minimum(before, curvature.shape[1] - 1)[:, None], axis=1)[:, 0]
    bodies = _Bodies(now, jnp.cos(now.yaw), jnp.sin(now.yaw), half_length, half_width, jnp.arange(len(now.x)), z)
    pressure = _pressure_of(disturbed, bodies, bend, progress.speed)
    accel = jnp.clip(_ACCEL * (1.0 - pressure), -ACCEL_LIMIT, _ACCEL)
    logged = _at(log.speed, log, progress.step)
    following = (pressure == 0.0) & (progress.speed >= logged - _ACCEL * dt)
    speed = jnp.clip(progress.speed + accel * dt, 0.0, logged)
    pace = jnp.where(
        logged > _STANDING_M_S,
        0.5 * (progress.speed + speed) / jnp.maximum(logged, _STANDING_M_S),
        pressure == 0.0,  # where the log stands, time passes unless another agent is in the way
    )
    step = progress.step + jnp.where(following, 1.0, jnp.clip(pace, 0.0, 1.0))
    ahead = _at(log.speed, log, step)
    return LogProgress(step, jnp.where(following, ahead, jnp.minimum(speed, ahead)))


class _Bodies(eqx.Module):
    """The bodies of agents [agent], as obstacles for others."""

    now: Motion
    cos: Float[Array, " agent"]
    sin: Float[Array, " agent"]
    half_length: Float[Array, " agent"]  # [m]
    half_width: Float[Array, " agent"]  # [m]
    index: Int[Array, " agent"]
    z: Float[Array, " agent"] | None  # [m]


def _pressure_of(
    disturbed: Bool[Array, " agent"], bodies: _Bodies, bend: Float[Array, " agent"], speed: Float[Array, " agent"]
) -> Float[Array, " agent"]:
    """The interaction (s* / s)^2 of each agent with the tightest disturbed agent in its way; 0 if none is within s*.

    Few agents are disturbed at a time, so a few are compared in each turn, instead of all pairs.
    """
    few = min(_AT_A_TIME, len(speed))

    def turn(now: tuple[Array, Array]) -> tuple[Array, Array]:
        left, pressure = now
        chosen = jax.lax.top_k(left, few)[1]
        ahead = jax.tree.map(lambda values: values[chosen], bodies)
        gap, closing = _gaps(bodies, bend, ahead)
        gap = jnp.where(left[chosen] > 0.0, gap, _FAR_M)
        return left.at[chosen].set(0.0), jnp.maximum(pressure, _pressure(speed[:, None], gap, closing))

    begin = disturbed.astype(speed.dtype), jnp.zeros_like(speed)
    return jax.lax.while_loop(lambda now: now[0].any(), turn, begin)[1]


def _pressure(
    speed: Float[Array, "agent 1"], gap: Float[Array, "agent ahead"], closing: Float[Array, "agent ahead"]
) -> Float[Array, " agent"]:
    """The interaction (s* / s)^2 with the tightest of the agents ahead; 0 if none is within s*."""
    wanted = _STANDSTILL_M + jnp.maximum(speed * _HEADWAY_S + speed * closing / (2.0 * (_ACCEL * _BRAKE) ** 0.5), 0.0)
    return jnp.where(gap < wanted, (wanted / jnp.maximum(gap, _CONTACT_M)) ** 2, 0.0).max(axis=1)


def _at(values: Float[Array, "agent time"], log: Motion, step: Float[Array, " agent"]) -> Float[Array, " agent"]:
    """`values` of the log, interpolated between two steps."""
    before, after, part = _neighbours(log, step)
    index = jnp.arange(values.shape[0])
    return values[index, before] * (1.0 - part) + values[index, after] * part


def _neighbours(log: Motion, step: Float[Array, " agent"]) -> tuple[Array, Array, Array]:
    last = log.x.shape[1] - 1
    before = jnp.clip(jnp.floor(step).astype(jnp.int32), 0, last)
    return before, jnp.minimum(before + 1, last), jnp.clip(step - before, 0.0, 1.0)


def _gaps(
    bodies: _Bodies, bend: Float[Array, " agent"], ahead: _Bodies
) -> tuple[Float[Array, "agent ahead"], Float[Array, "agent ahead"]]:
    """For every agent (row) the gap [m] to each agent `ahead` in its way, and the closing speed [m/s].

    The way is the arc on which the agent drives; distances along it and off it are exact for a circle.
    """
    now, then, cos, sin = bodies.now, ahead.now, bodies.cos, bodies.sin
    dx, dy = then.x[None] - now.x[:, None], then.y[None] - now.y[:, None]
    far, left = dx * cos[:, None] + dy * sin[:, None], dy * cos[:, None] - dx * sin[:, None]
    k = jnp.where(jnp.abs(bend) < _STRAIGHT, _STRAIGHT, bend)[:, None]
    # The direction of the arc beside the other agent, as a vector: only the arc length needs an angle.
    from_centre = jnp.sqrt((k * far) ** 2 + (1.0 - k * left) ** 2)
    arc_cos, arc_sin = (1.0 - k * left) / from_centre, k * far / from_centre
    along = _angle(arc_cos, arc_sin) / k
    off = (1.0 - from_centre) / k
    turned_cos, turned_sin = (
        cos[:, None] * arc_cos - sin[:, None] * arc_sin,
        sin[:, None] * arc_cos + cos[:, None] * arc_sin,
    )
    same = ahead.cos[None] * turned_cos + ahead.sin[None] * turned_sin
    across = jnp.abs(ahead.sin[None] * turned_cos - ahead.cos[None] * turned_sin)
    reach = jnp.abs(same) * ahead.half_length[None] + across * ahead.half_width[None]
    breadth = across * ahead.half_length[None] + jnp.abs(same) * ahead.half_width[None]
    inside = jnp.abs(off) - breadth < bodies.half_width[:, None] + _SIDE_MARGIN_M
    in_way = (bodies.index[:, None] != ahead.index[None]) & inside & (along > 0.0)
    if bodies.z is not None and ahead.z is not None:
        in_way &= same_level(bodies.z[:, None], ahead.z[None])
    gap = jnp.where(in_way, along - reach - bodies.half_length[:, None], _FAR_M)
    return gap, now.speed[:, None] - then.speed[None] * same


def _angle(cos: Float[Array, "*axes"], sin: Float[Array, "*axes"]) -> Float[Array, "*axes"]:
    """The angle of a unit vector, accurate to 2e-5 rad.

    It is twice the arc tangent of the half angle's tangent, by the polynomial 4.4.49 of Abramowitz and Stegun: XLA's
    arc tangent goes value by value and took two thirds of the time of a step.
    """
    steep = cos < 0.0  # beyond a right angle, computed from the other side
    tangent = sin / (1.0 + jnp.abs(cos))
    square = tangent**2
    series = 0.9998660 + square * (-0.3302995 + square * (0.1801410 + square * (-0.0851330 + square * 0.0208351)))
    angle = 2.0 * tangent * series
    return jnp.where(steep, jnp.sign(sin) * jnp.pi - angle, angle)
