"""The closed loop: background agents in closed form, the ego step by step under its planner.

Background agents follow open-loop controls, so what they do does not depend on the ego. Whatever
a planner derives from them alone is computed for all steps at once (`look`); only the ego's own
step runs in a loop. Gradients do not pass through the ego: its actions are constants of the
attack, as in the code of both papers, and that is what lets any planner be attacked.
"""

from typing import Any, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from regents_cosim.mirror.bicycle import Controls, Motion, clip, roll_out, step
from regents_cosim.mirror.world import World


class Traffic(eqx.Module):
    """The other road users in scene coordinates: [agent, time], or [agent] at one instant."""

    motion: Motion
    valid: Bool[Array, "*axes"]
    half_length: Float[Array, "*sizes"]  # [m]
    half_width: Float[Array, "*sizes"]  # [m]


@runtime_checkable
class LoopPlanner(Protocol):
    """A planner that runs inside the compiled loop. Memory and sight are pytrees of its own."""

    def look(self, memory: Any, traffic: Traffic) -> Any:
        """What it makes of the others: leaves [time, ...], row k only from step k of `traffic`."""
        ...

    def step(self, memory: Any, sight: Any, ego: Motion) -> tuple[Controls, Any]:
        """Its control at one step, from row k of `look` and the ego's state, and its next memory."""
        ...


def roll_out_background(world: World, controls: Controls) -> Motion:
    """Motion [agent, time] of all agents under open-loop `controls` [agent, step]; row 0 is not the ego's."""
    return roll_out(world.start, controls, world.moving, world.dt)


def drive(planner: LoopPlanner, memory: Any, world: World, background: Motion) -> tuple[Motion, Controls]:
    """The ego's motion [time] and controls [step] when `planner` drives among `background` [agent, time]."""
    sight = planner.look(memory, others(world, background))

    def advance(carry: tuple[Motion, Any], sight_now: Any) -> tuple[tuple[Motion, Any], tuple[Motion, Controls]]:
        ego, recalled = carry
        control, recalled = planner.step(recalled, sight_now, ego)
        control = clip(control)
        return (step(ego, control, world.dt), recalled), (ego, control)

    begin = jax.tree.map(lambda values: values[0], world.start)
    decisions = jax.tree.map(lambda values: values[:-1], sight)
    (last, _), (motion, controls) = jax.lax.scan(advance, (begin, memory), decisions)
    joined = jax.tree.map(lambda values, end: jnp.append(values, end), motion, last)
    return joined, controls


def others(world: World, background: Motion) -> Traffic:
    """All agents but the ego as a planner sees them."""
    motion = jax.tree.map(lambda values: values[1:], background)
    return Traffic(motion, world.valid[1:], world.half_length[1:], world.half_width[1:])


def with_ego(background: Motion, ego: Motion) -> Motion:
    """Motion of all agents, row 0 being the ego's."""
    return jax.tree.map(lambda values, mine: values.at[0].set(mine), background, ego)
