"""The exact twin of highway-env's vehicle, whose gradient is therefore that of the simulator itself.

highway-env integrates by forward Euler, with a slip angle beta at the box centre. With curvature k [1/m] in place of
its steering angle, sin(beta) = k L / 2, a step of dt is

    (x, y)' = (x, y) + u dt (cos, sin)(yaw + beta),   yaw' = yaw + k u dt,   u' = u + a dt,

where a is at most 40 - u [m/s^2] for u > 40 m/s. The one difference: a braking vehicle stops here, where highway-env's
would reverse; until then, and for accelerations that just stop it, both are equal. Only the speed needs a loop over
time, the rest are cumulative sums. Source: `Vehicle.step` and `Vehicle.clip_actions` of highway-env 1.12 (MIT), in the
frame of this package.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from regents_cosim.mirror.bicycle import ControlArrays, Motion, accumulate, wrap

TOP_SPEED = 40.0  # [m/s] above this speed highway-env brakes
# Vehicles under highway-env's own control steer up to 60 degrees: sin(arctan(tan(60 degrees) / 2)).
LARGEST_SLIP_SINE = 0.6546536707

_MIN_TRAVEL_M = 1e-6  # a vehicle that moves less in a step has no measurable curvature


def step(
    state: Motion, control: ControlArrays, half_length: Float[Array, "*#axes"], dt: Float[Array, ""] | float
) -> Motion:
    """The state one step of `dt` [s] later; all fields broadcast."""
    sine = _slip_sine(control.curvature, half_length)
    travelled = state.speed * dt
    course = state.yaw + jnp.arcsin(sine)
    return Motion(
        state.x + travelled * jnp.cos(course),
        state.y + travelled * jnp.sin(course),
        state.yaw + travelled * sine / half_length,
        _next_speed(state.speed, control.accel, dt),
    )


def roll_out(
    start: Motion,
    controls: ControlArrays,
    moving: Bool[Array, "agent step"],
    half_length: Float[Array, " agent"],
    dt: Float[Array, ""] | float,
) -> Motion:
    """Motion [agent, step + 1] from `start` [agent] under `controls` [agent, step]; agents wait while not `moving`.

    The result equals repeated `step` up to rounding.
    """

    def advance(speed: Array, now: tuple[Array, Array]) -> tuple[Array, Array]:
        accel, moves = now
        ahead = jnp.where(moves, _next_speed(speed, accel, dt), speed)
        return ahead, ahead

    _, later = jax.lax.scan(advance, start.speed, (controls.accel.T, moving.T))
    speed = jnp.concatenate([start.speed[:, None], later.T], axis=1)
    sine = _slip_sine(controls.curvature, half_length[:, None])
    travelled = jnp.where(moving, speed[:, :-1] * dt, 0.0)
    yaw = accumulate(start.yaw, travelled * sine / half_length[:, None])
    course = yaw[:, :-1] + jnp.arcsin(sine)
    x = accumulate(start.x, travelled * jnp.cos(course))
    y = accumulate(start.y, travelled * jnp.sin(course))
    return Motion(x, y, yaw, speed)


def controls_between(motion: Motion, dt: Float[Array, ""] | float) -> ControlArrays:
    """Controls [agent, step] that lead from each state of `motion` [agent, step + 1] to the next.

    They are exact for motions of this model, with the accelerations that were reached. Standing vehicles have curvature
    0.
    """
    travelled = motion.speed[:, :-1] * dt
    turned = wrap(jnp.diff(motion.yaw, axis=1))
    curvature = jnp.where(travelled > _MIN_TRAVEL_M, turned / jnp.maximum(travelled, _MIN_TRAVEL_M), 0.0)
    return ControlArrays(jnp.diff(motion.speed, axis=1) / dt, curvature)


def _slip_sine(curvature: Float[Array, "*#axes"], half_length: Float[Array, "*#axes"]) -> Float[Array, "*axes"]:
    return jnp.clip(curvature * half_length, -LARGEST_SLIP_SINE, LARGEST_SLIP_SINE)


def _next_speed(
    speed: Float[Array, "*#axes"], accel: Float[Array, "*#axes"], dt: Float[Array, ""] | float
) -> Float[Array, "*axes"]:
    accel = jnp.where(speed > TOP_SPEED, jnp.minimum(accel, TOP_SPEED - speed), accel)
    ahead = speed + accel * dt
    return jnp.where(ahead >= 0.0, ahead, 0.0)  # at exactly 0 the gradient is that of starting
