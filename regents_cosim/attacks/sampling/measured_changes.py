"""Evaluate changes of an agent's actions for searches for diverse crashes: a value and two measures.

The value is minus the attack's cost. The measures are the speed and the time at which the agent comes nearest to the
ego, as means over the moments near that one.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from regents_cosim.attacks.descent.search import set_up
from regents_cosim.attacks.descent.search_state import SearchResult, SearchState
from regents_cosim.attacks.descent.step import Descent
from regents_cosim.attacks.job import SearchJob
from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.attacks.sampling.sampled_search import pace, with_change
from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.planners.jax_planner import JaxPlanner

_NEAR_M = 2.0  # distance over which the weight of a moment falls to a third
_SMOOTH_M2 = 1e-3  # keeps square roots smooth at 0 (m^2, or m^2/s^2)


@compiled
def try_changes(
    job: SearchJob,
    planner: JaxPlanner,
    config: AttackConfig,
    starts: ControlArrays,
    changes: Float[Array, "change coordinate"],
) -> tuple[Float[Array, "change row"], Bool[Array, " change"]]:
    """The value and the measures of each change of its start [change searched step], and whether it is accepted."""
    same = _descent(job, planner, config)

    def one(given: tuple[ControlArrays, Float[Array, " coordinate"]]) -> tuple[Array, Array]:
        start, change = given
        descent = replace(same, start=start)
        search = _seen(descent, change)
        return _rows(descent, search.seen.motion, search.actions), search.accepted

    return jax.lax.map(one, (starts, changes))


@compiled
def end_with(
    job: SearchJob, planner: JaxPlanner, config: AttackConfig, change: Float[Array, " coordinate"]
) -> SearchResult:
    """A search result as if the search had ended with this change."""
    descent = _descent(job, planner, config)
    return descent.result(replace(_seen(descent, change), iterations=jnp.int32(1)))


def _descent(job: SearchJob, planner: JaxPlanner, config: AttackConfig) -> Descent:
    return set_up(job.world, planner, job.memory, config, job.searched, job.start)


def _seen(descent: Descent, change: Float[Array, " coordinate"]) -> SearchState:
    return descent.seeing(replace(descent.begin(), actions=_changed(descent, change)))


def _changed(descent: Descent, change: Float[Array, " coordinate"]) -> ControlArrays:
    return descent.allowed(with_change(descent.first(), change, pace(descent.world, descent.searched)))


def _rows(descent: Descent, motion: Motion, actions: ControlArrays) -> Float[Array, " row"]:
    total, _ = descent.cost(descent.world.boxes(motion), motion, actions)
    ego = jax.tree.map(lambda values: values[0], motion)
    own = jax.tree.map(lambda values: values[0], descent.searched.rows(motion))
    both = descent.world.valid[0] & descent.searched.rows(descent.world.valid)[0]
    return jnp.stack([-total, *nearest_approach(ego, own, both, descent.world.dt)])


def nearest_approach(
    ego: Motion, other: Motion, both: Bool[Array, " time"], dt: Float[Array, ""]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Relative speed [m/s] and time [s] of the nearest approach of two agents, while `both` are present.

    Both are means over time in which a moment weighs exp(-d / 2 m), with d the distance of the centres.
    """
    apart = _length(other.x - ego.x, other.y - ego.y)
    near = jax.nn.softmax(jnp.where(both, -apart / _NEAR_M, -jnp.inf))
    dx = other.speed * jnp.cos(other.yaw) - ego.speed * jnp.cos(ego.yaw)
    dy = other.speed * jnp.sin(other.yaw) - ego.speed * jnp.sin(ego.yaw)
    return jnp.sum(near * _length(dx, dy)), jnp.sum(near * dt * jnp.arange(near.shape[0]))


def _length(x: Float[Array, "*axes"], y: Float[Array, "*axes"]) -> Float[Array, "*axes"]:
    return jnp.sqrt(x**2 + y**2 + _SMOOTH_M2)
