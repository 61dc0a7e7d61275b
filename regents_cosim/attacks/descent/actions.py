"""The actions of a search: controls as shares of the mirror's limits, and the actions that the configuration allows."""

import jax
import jax.numpy as jnp

from regents_cosim.attacks.descent.driving_limits import within_bounds
from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.mirror.bicycle import ControlArrays, accumulate, running_minimum
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.world import World
from regents_cosim.norms.limits import ACCEL_LIMIT, CURVATURE_LIMIT

_ROUNDING = 1e-6  # of an action


def to_actions(controls: ControlArrays) -> ControlArrays:
    """Convert controls to shares of the mirror's limits."""
    return ControlArrays(controls.accel / ACCEL_LIMIT, controls.curvature / CURVATURE_LIMIT)


def to_controls(actions: ControlArrays) -> ControlArrays:
    """Convert shares of the mirror's limits to controls, the inverse of `to_actions`."""
    return ControlArrays(actions.accel * ACCEL_LIMIT, actions.curvature * CURVATURE_LIMIT)


def allowed(
    actions: ControlArrays, logged: ControlArrays, world: World, searched: SearchedAgents, config: AttackConfig
) -> ControlArrays:
    """The nearest actions [searched step] that the configuration allows; logged actions always are."""
    most = config.limits.max_deviation
    if most > 0.0:
        actions = jax.tree.map(lambda a, log: jnp.clip(a, log - most, log + most), actions, logged)
    actions = jax.tree.map(lambda values: jnp.clip(values, -1.0, 1.0), actions)
    if config.bound:
        actions = not_too_fast(actions, world, searched)
    if world.bounds is None:
        return actions
    return to_actions(within_bounds(world, searched, to_controls(actions)))


@compiled
def held_to_limits(
    drives: ControlArrays, world: World, searched: SearchedAgents, config: AttackConfig
) -> ControlArrays:
    """Drives [drive searched step], changed only where the configuration does not allow them."""
    logged = searched.rows(to_actions(world.controls))
    nearest = jax.vmap(lambda drive: allowed(drive, logged, world, searched, config))(drives)
    return jax.tree.map(lambda given, near: jnp.where(jnp.abs(given - near) > _ROUNDING, near, given), drives, nearest)


def not_too_fast(actions: ControlArrays, world: World, searched: SearchedAgents) -> ControlArrays:
    """The actions [searched step], with accelerations reduced where an agent would exceed its top speed."""
    rows = searched.rows
    begun, moving, most = rows(world.start.speed), rows(world.moving), rows(world.top_speed)[:, None]
    summed = accumulate(begun, jnp.where(moving, to_controls(actions).accel * world.dt, 0.0))
    wanted = summed - running_minimum(jnp.minimum(summed, 0.0), 0.0)  # an agent that stands does not get slower
    accel = jnp.diff(jnp.minimum(wanted, most)) / (ACCEL_LIMIT * world.dt)
    too_fast = moving & (wanted[:, 1:] > most)
    return ControlArrays(jnp.where(too_fast, jnp.minimum(actions.accel, accel), actions.accel), actions.curvature)
