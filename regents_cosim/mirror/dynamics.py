"""Which model vehicles move by: our own bicycle, or the twin of highway-env's."""

import jax
from jaxtyping import Array, Bool, Float

from regents_cosim.mirror import bicycle, highway_bicycle
from regents_cosim.mirror.bicycle import Controls, Motion
from regents_cosim.scenario import Dynamics


def step(
    dynamics: Dynamics,
    state: Motion,
    control: Controls,
    half_length: Float[Array, "*#axes"],
    dt: Float[Array, ""] | float,
) -> Motion:
    """Advance by one step; all fields broadcast."""
    if dynamics == "highway":
        return highway_bicycle.step(state, control, half_length, dt)
    return bicycle.step(state, control, dt)


def roll_out(
    dynamics: Dynamics,
    start: Motion,
    controls: Controls,
    moving: Bool[Array, "agent step"],
    half_length: Float[Array, " agent"],
    dt: Float[Array, ""] | float,
) -> Motion:
    """Motion [agent, step + 1] from `start` [agent] under `controls` [agent, step]; agents wait while not `moving`."""
    if dynamics == "highway":
        return highway_bicycle.roll_out(start, controls, moving, half_length, dt)
    return bicycle.roll_out(start, controls, moving, dt)


def pull_back(
    dynamics: Dynamics,
    start: Motion,
    controls: Controls,
    moving: Bool[Array, "agent step"],
    half_length: Float[Array, " agent"],
    dt: Float[Array, ""] | float,
    motion: Motion,
    heading: tuple[Float[Array, "agent time"], Float[Array, "agent time"]],
    gradient: Motion,
) -> Controls:
    """The gradient with respect to `controls` of what has `gradient` with respect to their roll-out `motion`.

    `heading` is the cosine and sine of its yaw. highway-env's model is rolled out once more.
    """
    if dynamics == "highway":
        _, back = jax.vjp(lambda own: highway_bicycle.roll_out(start, own, moving, half_length, dt), controls)
        return back(gradient)[0]
    return bicycle.pull_back(controls, moving, dt, motion, heading, gradient)[1]


def controls_between(dynamics: Dynamics, motion: Motion, dt: Float[Array, ""] | float) -> Controls:
    """Controls [agent, step] that lead from each state of `motion` [agent, step + 1] to the next."""
    if dynamics == "highway":
        return highway_bicycle.controls_between(motion, dt)
    return bicycle.controls_between(motion, dt)
