"""Which model vehicles move by: our own bicycle, or the twin of highway-env's."""

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


def controls_between(dynamics: Dynamics, motion: Motion, dt: Float[Array, ""] | float) -> Controls:
    """Controls [agent, step] that lead from each state of `motion` [agent, step + 1] to the next."""
    if dynamics == "highway":
        return highway_bicycle.controls_between(motion, dt)
    return bicycle.controls_between(motion, dt)
