"""How hard the adversary may drive, and the nearest controls that keep to it."""

from collections.abc import Mapping
from dataclasses import fields, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.attacks.searched_agents import SearchedAgents
from regents_cosim.mirror.bicycle import Controls, accumulate, stopping_speed
from regents_cosim.mirror.world import DriveBounds, World
from regents_cosim.scenario import VEHICLE_KINDS, Scenario
from regents_cosim.verdicts.ordinary import DrivingLimits, ordinary

_LIMITED = tuple(field.name for field in fields(DriveBounds))
_NO_BOUND = 1e3  # m/s^2 and m/s^3: no control of the mirror comes near
_SLOWEST_M_S = 1.0  # below, curvature is bounded as if it were as fast: who crawls may turn on the spot


def limits_by_kind(scenario: Scenario, config: AttackConfig) -> dict[str, DrivingLimits]:
    """For each kind of vehicle what the configuration asks for in numbers, and ordinary driving where it names none."""
    given = {name: getattr(config, f"max_{name}") for name in _LIMITED}
    given = {name: value for name, value in given.items() if value > 0.0}
    kinds = {agent.kind for agent in scenario.agents} & VEHICLE_KINDS
    return {kind: replace(ordinary(scenario, kind), **given) for kind in kinds}


def with_bounds(world: World, scenario: Scenario, config: AttackConfig, limits: Mapping[str, DrivingLimits]) -> World:
    """The same world with bounds for its vehicles, where the configuration has any."""
    numbers = {name: getattr(config, f"max_{name}") for name in _LIMITED}
    if config.driving == "any" and not any(numbers.values()):
        return world
    rows = {name: np.full(len(world.valid), value or _NO_BOUND, np.float32) for name, value in numbers.items()}
    for agent, one in enumerate(scenario.agents):
        if config.driving == "ordinary" and one.kind in limits:
            for name, row in rows.items():
                row[agent] = getattr(limits[one.kind], name)
    return replace(world, bounds=DriveBounds(**{name: jnp.asarray(row) for name, row in rows.items()}))


def within_bounds(world: World, searched: SearchedAgents, controls: Controls) -> Controls:
    """The nearest `controls` [searched step] within the world's bounds; those that reproduce the log always are."""
    if world.bounds is None:
        return controls
    rows = searched.rows
    bounds, logged, moving = rows(world.bounds), rows(world.controls), rows(world.moving)
    accel = _eased(controls.accel, logged.accel, moving, bounds, world.dt)
    speed = stopping_speed(rows(world.start.speed), jnp.where(moving, accel, 0.0) * world.dt)
    tightest = _lateral(bounds, logged, rows(world.log.speed)) / jnp.maximum(_square(speed), _SLOWEST_M_S**2)
    return Controls(accel, jnp.clip(controls.curvature, -tightest, tightest))


def _eased(
    accel: Float[Array, "searched step"],
    logged: Float[Array, "searched step"],
    moving: Array,
    bounds: DriveBounds,
    dt: Float[Array, ""],
) -> Float[Array, "searched step"]:
    """Clipped, and changing by no more than the jerk allows from step to step, the first from what the log begins with.

    The mean of the least function above and the greatest below that keep to the jerk (McShane 1934): of all that do,
    none has a smaller greatest difference.
    """
    change = jnp.maximum((bounds.jerk * dt)[:, None], jnp.abs(jnp.diff(logged, axis=1)))
    place = accumulate(jnp.zeros(len(accel)), change)  # along the steps, in what the acceleration may change by
    first = jnp.argmax(moving, axis=1)[:, None]
    since = jnp.maximum(place - jnp.take_along_axis(place, first, axis=1), 0.0)
    begun = jnp.take_along_axis(logged, first, axis=1)
    most = jnp.maximum(jnp.minimum(bounds.accel[:, None], begun + since), logged)
    least = jnp.minimum(jnp.maximum(-bounds.braking[:, None], begun - since), logged)
    clipped = jnp.clip(accel, least, most)[:, None]
    apart = jnp.abs(place[:, :, None] - place[:, None, :])
    return 0.5 * ((clipped + apart).min(axis=2) + (clipped - apart).max(axis=2))


def _lateral(
    bounds: DriveBounds, logged: Controls, speed: Float[Array, "searched time"]
) -> Float[Array, "searched step"]:
    """Sideways acceleration that is allowed at each step [m/s^2]: as much as in the log, too."""
    return jnp.maximum(bounds.lateral_accel[:, None], jnp.abs(logged.curvature) * _square(speed))


def _square(speed: Float[Array, "searched time"]) -> Float[Array, "searched step"]:
    """The square of the mean speed of each step."""
    return (0.5 * (speed[:, :-1] + speed[:, 1:])) ** 2
