"""The state of agents that react, and what is given of all agents at a step."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.lookup import interpolate
from regents_cosim.mirror.reactions.bodies import arc_tangent


class Reacting(eqx.Module):
    """The state of agents that follow the path of their log, later than it or beside it."""

    step: Float[Array, " agent"]  # of the log, at most the present step
    speed: Float[Array, " agent"]  # [m/s] along the path
    left: Float[Array, " agent"]  # [m] of the path; negative: to its right
    drift: Float[Array, " agent"]  # [m/s] to the left
    aim: Float[Array, " agent"]  # [m] left of the path, where the agent drives to
    pressure: Float[Array, " agent"]  # the interaction with the tightest agent that is or will be in its way
    needed: Float[Array, " agent"]  # [m/s^2] braking that those in its way make necessary
    held_up: Float[Array, " agent"]  # [s] for which others have made it brake
    yaw: Float[Array, " agent"]  # [rad] of all agents one step ago, from which others see them turn


class BackgroundInstant(eqx.Module):
    """What is given of the background at one step, or [time, agent] at all steps."""

    index: Int[Array, "*time"]  # of the step
    own: Motion  # [agent] the agents' own tracks: their log, or what an attack makes of it
    log: Motion  # [agent] as recorded
    present: Bool[Array, "*time agent"]
    moving: Bool[Array, "*time agent"]  # whether the agent has entered before the next step


def begin(log: Motion) -> Reacting:
    """The state of agents at the begin of their logs [agent time]."""
    still = jnp.zeros_like(log.speed[:, 0])
    return Reacting(still, log.speed[:, 0], still, still, still, still, still, still, log.yaw[:, 0])


def place(log: Motion, state: Reacting) -> Motion:
    """Poses [agent] of agents in a `state`; `log` is [agent time]."""
    x, y, yaw = at_step(state.step, log.x, log.y, log.yaw)
    left = state.left
    return Motion(x - left * jnp.sin(yaw), y + left * jnp.cos(yaw), yaw + aside(state), state.speed)


def aside(state: Reacting) -> Float[Array, " agent"]:
    """The angle [rad] between the way that an agent drives and its path."""
    return arc_tangent(jnp.clip(state.drift / jnp.maximum(state.speed, 1.0), -1.0, 1.0))


def at_step(step: Float[Array, " agent"], *logged: Float[Array, "agent time"]) -> tuple[Float[Array, " agent"], ...]:
    """Values of the log, each interpolated between two steps."""
    before, after, part = neighbours(logged[0], step)
    index = jnp.arange(len(step))
    return tuple(interpolate(values, (index, before), (index, after), part) for values in logged)


def neighbours(
    values: Float[Array, "agent time"], step: Float[Array, " agent"]
) -> tuple[Int[Array, " agent"], Int[Array, " agent"], Float[Array, " agent"]]:
    """The steps before and after `step`, and how far it is from the first to the second."""
    last = values.shape[1] - 1
    before = jnp.clip(jnp.floor(step).astype(jnp.int32), 0, last)
    return before, jnp.minimum(before + 1, last), jnp.clip(step - before, 0.0, 1.0)
