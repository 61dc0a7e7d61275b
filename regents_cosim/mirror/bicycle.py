"""Kinematic bicycle: how a controlled vehicle moves, step by step and in closed form.

Controls are acceleration a [m/s^2] and curvature k [1/m]; the reference point is the box centre,
which moves where the box points (no slip). Over one step of dt

    u' = max(u + a dt, 0),   ds = (u + u') dt / 2,   yaw' = yaw + k ds,
    (x, y)' = (x, y) + ds (cos, sin)((yaw + yaw') / 2)

A braking vehicle stops and never reverses. For given controls this is a chain of cumulative
sums: `roll_out` needs no loop over time. `controls_between` is the exact inverse.

A pedestrian is a point mass that faces where it goes, with its velocity held as speed and heading.
It moves by the same chain, but its heading turns with time instead of distance,

    yaw' = yaw + k w dt,   w = `TURN_PACE_M_S`,

so that it can turn on the spot, and both controls have the same range for all agents: k w [rad/s]
is its turn rate.

Gradient at standstill: where a step would have ended below zero speed (strictly), the speed does
not depend on what came before, so the gradient is 0 there; at exactly zero it is the one-sided
derivative for accelerating, so that a standing vehicle can be set in motion.

Source: kinematic bicycle without slip (Rajamani 2012, ch. 2.2) with curvature as the input;
zero slip at the box centre tracks SUMO best (yaw error p99 5 degrees against 19 for a rear-axle
reference at the same 2 cm position error).
"""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Num

from regents_cosim.geometry.lines import midway
from regents_cosim.norms.limits import ACCEL_LIMIT, CURVATURE_LIMIT

# A pedestrian turns as fast as curvature would turn a vehicle at this speed: 0.3 1/m are 3 rad/s, half a turn per
# second.
TURN_PACE_M_S = 10.0

_MIN_TRAVEL_M = 1e-4  # a vehicle that moves less in a step has no measurable curvature


class Motion(eqx.Module):
    """Box centres, yaws and speeds: shape [agent, time], or [agent] at one instant, or [] of one agent at one instant.

    A planner gets them in its scene's coordinates (`CompiledScene.origin`).
    """

    x: Float[Array, "*axes"]  # [m]
    y: Float[Array, "*axes"]  # [m]
    yaw: Float[Array, "*axes"]  # [rad] counter-clockwise from +x, continuous over time
    speed: Float[Array, "*axes"]  # [m/s] never negative


class ControlArrays(eqx.Module):
    """Controls as JAX arrays, constant over each step: scalars from a planner, else shape [agent, step].

    A planner outside JAX returns a `Control` instead.
    """

    accel: Float[Array, "*axes"]  # [m/s^2]
    curvature: Float[Array, "*axes"]  # [1/m] positive turns left; for pedestrians turn rate / `TURN_PACE_M_S`


def step(
    state: Motion, control: ControlArrays, dt: Float[Array, ""] | float, walks: Bool[Array, "*#axes"] | None = None
) -> Motion:
    """The state one step of `dt` [s] later; all fields broadcast."""
    ahead = state.speed + control.accel * dt
    speed = jnp.where(ahead < 0.0, 0.0, ahead)
    travelled = 0.5 * (state.speed + speed) * dt
    yaw = state.yaw + control.curvature * turning_way(travelled, walks, dt)
    mid = 0.5 * (state.yaw + yaw)
    return Motion(state.x + travelled * jnp.cos(mid), state.y + travelled * jnp.sin(mid), yaw, speed)


@jax.custom_vjp
def roll_out(
    start: Motion,
    controls: ControlArrays,
    moving: Bool[Array, "agent step"],
    dt: Float[Array, ""] | float,
    walks: Bool[Array, " agent"] | None = None,
) -> Motion:
    """Motion [agent, step + 1] from `start` [agent] under `controls` [agent, step]; `walks` marks pedestrians.

    While `moving` is False an agent waits at `start` and keeps its speed, so an agent that enters late begins at its
    own first step. The result equals repeated `step` up to rounding.
    """
    speed = stopping_speed(start.speed, jnp.where(moving, controls.accel, 0.0) * dt)
    travelled = _travelled(speed, moving, dt)
    yaw = accumulate(start.yaw, controls.curvature * _turning(travelled, walks, moving, dt))
    mid = midway(yaw)
    x = accumulate(start.x, travelled * jnp.cos(mid))
    y = accumulate(start.y, travelled * jnp.sin(mid))
    return Motion(x, y, yaw, speed)


def pull_back(
    controls: ControlArrays,
    moving: Bool[Array, "agent step"],
    dt: Float[Array, ""] | float,
    motion: Motion,
    heading: tuple[Float[Array, "agent time"], Float[Array, "agent time"]],
    gradient: Motion,
    walks: Bool[Array, " agent"] | None = None,
) -> tuple[Motion, ControlArrays]:
    """Gradients with respect to `start` [agent] and `controls`, given the `gradient` with respect to `motion`.

    This is the transpose of `roll_out`, whose result `motion` [agent, time] is: a chain of suffix sums that needs only
    the result and its `heading`, the cosine and sine of the yaw.
    """
    travelled = _travelled(motion.speed, moving, dt)
    cos, sin = (midway(values) for values in heading)
    length = jnp.sqrt(cos**2 + sin**2)  # length of the sum of two unit vectors; the sum points half-way between them
    cos, sin = cos / length, sin / length
    later_x, later_y = _later(gradient.x), _later(gradient.y)
    turned = _spread(gradient.yaw, travelled * (cos * later_y - sin * later_x))
    later_yaw = _later(turned)
    bends = controls.curvature if walks is None else jnp.where(walks[:, None], 0.0, controls.curvature)
    per_metre = jnp.where(moving, cos * later_x + sin * later_y + bends * later_yaw, 0.0)
    gains = jnp.where(moving, controls.accel, 0.0) * dt
    gained = _until_stop(_spread(gradient.speed, dt * per_metre), motion.speed, gains)
    start = Motion(gradient.x.sum(axis=1), gradient.y.sum(axis=1), turned.sum(axis=1), gained[:, 0])
    on_curvature = _turning(travelled, walks, moving, dt) * later_yaw
    return start, ControlArrays(jnp.where(moving, gained[:, 1:] * dt, 0.0), on_curvature)


def _roll_out_forward(
    start: Motion,
    controls: ControlArrays,
    moving: Bool[Array, "agent step"],
    dt: Float[Array, ""] | float,
    walks: Bool[Array, " agent"] | None = None,
) -> tuple[Motion, Any]:
    motion = roll_out(start, controls, moving, dt, walks)
    return motion, (controls, moving, dt, motion, walks)


def _roll_out_backward(kept: Any, gradient: Motion) -> tuple[Motion, ControlArrays, None, None, None]:
    controls, moving, dt, motion, walks = kept
    heading = jnp.cos(motion.yaw), jnp.sin(motion.yaw)
    start, on_controls = pull_back(controls, moving, dt, motion, heading, gradient, walks)
    return start, on_controls, None, None, None


roll_out.defvjp(_roll_out_forward, _roll_out_backward)


def controls_between(
    motion: Motion, dt: Float[Array, ""] | float, walks: Bool[Array, " agent"] | None = None
) -> ControlArrays:
    """Controls [agent, step] that lead from each state of `motion` [agent, step + 1] to the next.

    They are exact for motions of this model; for other tracks they are the local estimate of the ReGentS paper, section
    3.1, from differences of speed and yaw. Standing vehicles have curvature 0.
    """
    travelled = turning_way(midway(motion.speed) * dt, _column(walks), dt)
    turned = wrap(jnp.diff(motion.yaw, axis=1))
    curvature = jnp.where(travelled > _MIN_TRAVEL_M, turned / jnp.maximum(travelled, _MIN_TRAVEL_M), 0.0)
    return ControlArrays(jnp.diff(motion.speed, axis=1) / dt, curvature)


def clip(controls: ControlArrays, most_braking: float = ACCEL_LIMIT) -> ControlArrays:
    """Clip controls to the limits of the mirror, braking to at most `most_braking` [m/s^2]."""
    return ControlArrays(
        jnp.clip(controls.accel, -most_braking, ACCEL_LIMIT),
        jnp.clip(controls.curvature, -CURVATURE_LIMIT, CURVATURE_LIMIT),
    )


def turning_way(
    travelled: Float[Array, "*axes"], walks: Bool[Array, "*#axes"] | None, dt: Float[Array, ""] | float
) -> Float[Array, "*axes"]:
    """The distance [m] over which curvature turns an agent: its travel, or for pedestrians one proportional to time."""
    return travelled if walks is None else jnp.where(walks, TURN_PACE_M_S * dt, travelled)


def wrap(angle: Float[Array, "*axes"]) -> Float[Array, "*axes"]:
    """An angle [rad] brought into [-pi, pi), the direction unchanged."""
    return jnp.mod(angle + jnp.pi, 2.0 * jnp.pi) - jnp.pi


def _travelled(
    speed: Float[Array, "agent time"], moving: Bool[Array, "agent step"], dt: Float[Array, ""] | float
) -> Float[Array, "agent step"]:
    return jnp.where(moving, midway(speed) * dt, 0.0)


def _turning(
    travelled: Float[Array, "agent step"],
    walks: Bool[Array, " agent"] | None,
    moving: Bool[Array, "agent step"],
    dt: Float[Array, ""] | float,
) -> Float[Array, "agent step"]:
    """`turning_way` of agents, 0 while they are not `moving`."""
    return travelled if walks is None else jnp.where(moving, turning_way(travelled, _column(walks), dt), 0.0)


def _column(walks: Bool[Array, " agent"] | None) -> Bool[Array, "agent 1"] | None:
    return None if walks is None else walks[:, None]


def _spread(gradient: Float[Array, "agent time"], on_means: Float[Array, "agent step"]) -> Float[Array, "agent time"]:
    """`gradient` plus the transpose of `midway` applied to `on_means`."""
    return gradient + 0.5 * (jnp.pad(on_means, ((0, 0), (0, 1))) + jnp.pad(on_means, ((0, 0), (1, 0))))


def accumulate(start: Float[Array, " agent"], increments: Float[Array, "agent step"]) -> Float[Array, "agent time"]:
    """`start` plus the running sums of `increments`, with `start` first.

    It is a product with a triangular matrix: for 32 x 80 values XLA's CPU backend takes 6 us for it and 12 us for its
    cumulative sum.
    """
    steps = increments.shape[1]
    return start[:, None] + increments @ np.triu(np.ones((steps, steps + 1), increments.dtype), k=1)


def running_minimum(values: Num[Array, "agent time"], top: float | int) -> Num[Array, "agent time"]:
    """The running minimum over time of values that are at most `top`.

    It takes the minimum of the last 4 values, then of the last 16, and so on: for 32 x 81 values 7 us and 4 kernels to
    compile, where `jax.lax.associative_scan` takes 12 us and 12 kernels.
    """
    times = values.shape[1]
    reach = 1
    while reach < times:
        before = jnp.pad(values, ((0, 0), (3 * reach, 0)), constant_values=top)
        shifted = (before[:, shift * reach :][:, :times] for shift in range(3))
        values = functools.reduce(jnp.minimum, shifted, values)
        reach *= 4
    return values


def _later(values: Float[Array, "agent time"]) -> Float[Array, "agent step"]:
    """For every step the sum of the `values` after it: the transpose of `accumulate`."""
    steps = values.shape[1] - 1
    return values @ np.tril(np.ones((steps + 1, steps), values.dtype), k=-1)


def stopping_speed(start: Float[Array, " agent"], gains: Float[Array, "agent step"]) -> Float[Array, "agent time"]:
    """Speeds u_{k+1} = max(u_k + gain_k, 0), computed as v - min(0, running minimum of v) with the plain sums v."""
    plain = accumulate(start, gains)
    return plain - jnp.minimum(running_minimum(plain, jnp.inf), 0.0)


def _until_stop(
    gradient: Float[Array, "agent time"], speed: Float[Array, "agent time"], gains: Float[Array, "agent step"]
) -> Float[Array, "agent time"]:
    """The effect of a change of the start speed and of every gain on all later speeds up to the next stop.

    It is a difference of two suffix sums of `gradient`.
    """
    steps = gradient.shape[1]
    stopped = jnp.pad(speed[:, :-1] + gains < 0.0, ((0, 0), (1, 0)))
    suffix = gradient @ np.tril(np.ones((steps, steps + 1), gradient.dtype))
    index = jnp.where(stopped, jnp.arange(steps), steps)
    next_stop = running_minimum(index[:, ::-1], steps)[:, ::-1]
    return suffix[:, :-1] - jnp.take_along_axis(suffix, next_stop, axis=1, mode="promise_in_bounds")
