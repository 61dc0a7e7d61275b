"""The limits within which an adversary may drive, and the nearest controls that keep them."""

from collections.abc import Mapping
from dataclasses import fields, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.geometry.lines import midway
from regents_cosim.mirror.bicycle import TURN_PACE_M_S, ControlArrays, stopping_speed
from regents_cosim.mirror.programs.on_device import on_device
from regents_cosim.mirror.world import DriveBounds, World
from regents_cosim.norms.limits import ACCEL_WINDOW_S, steps_of
from regents_cosim.scenario.scenario import VEHICLE_KINDS, Scenario
from regents_cosim.verdicts.handling import MEAN_S
from regents_cosim.verdicts.ordinary import AT_ONCE_M_S3, DrivingLimits, ordinary

_LIMITED = tuple(field.name for field in fields(DriveBounds))
_NO_BOUND = 1e3  # m/s^2 and m/s^3: no control of the mirror comes near
_ROUNDING = 1e-3  # share of a number of seconds
SLOWEST_TURN_M_S = 1.0  # below it curvature is bounded as at this speed: a crawling agent may turn on the spot
# For pedestrians: the mean speed of a second times its mean turn rate exceeds the product in each step by up to 3.2 %,
# if the speed changes by 0.85 m/s in that second.
STEADY_TURN = 0.965
_ON_FOOT = 0.999  # share of what people do, so that single precision stays below
_AS_LOGGED = 1e-4, 1e-5  # m/s^2 and 1/m: controls that differ less from the log are the log's


def limits_by_kind(scenario: Scenario, config: AttackConfig) -> dict[str, DrivingLimits]:
    """The limits of each kind that may attack: the configured numbers, otherwise what is ordinary."""
    given = {name: getattr(config.limits, f"max_{name}") for name in _LIMITED}
    given = {name: value for name, value in given.items() if value > 0.0}
    kinds = {agent.kind for agent in scenario.agents} & config.candidates.kinds
    found = {kind: ordinary(scenario, kind) for kind in kinds}
    if walking := found.get("pedestrian"):
        found["pedestrian"] = replace(walking, **{name: _ON_FOOT * getattr(walking, name) for name in _LIMITED})
    return {kind: replace(limits, **given) for kind, limits in found.items()}


def with_bounds(world: World, scenario: Scenario, config: AttackConfig, limits: Mapping[str, DrivingLimits]) -> World:
    """The world with bounds for the agents that may attack, if the configuration has any.

    Cyclists and pedestrians always keep to what is ordinary for them, as the limits of the mirror are those of cars.
    """
    numbers = {name: getattr(config.limits, f"max_{name}") for name in _LIMITED}
    own = limits.keys() - VEHICLE_KINDS
    if config.limits.driving == "any" and not any(numbers.values()) and not own:
        return world
    rows = {name: np.full(len(world.valid), value or _NO_BOUND, np.float32) for name, value in numbers.items()}
    for agent, one in enumerate(scenario.agents):
        if one.kind in (limits if config.limits.driving == "ordinary" else own):
            for name, row in rows.items():
                row[agent] = getattr(limits[one.kind], name)
    return replace(world, bounds=DriveBounds(**{name: on_device(row, np.float32) for name, row in rows.items()}))


def within_bounds(world: World, searched: SearchedAgents, controls: ControlArrays) -> ControlArrays:
    """The nearest `controls` [searched step] within the world's bounds; controls that reproduce the log always are.

    A driver may do what its log does at the same time; a pedestrian only until it leaves its log.
    """
    if world.bounds is None:
        return controls
    rows = searched.rows
    bounds, logged, moving = rows(world.bounds), rows(world.controls), rows(world.moving)
    first = jnp.argmax(moving, axis=1)[:, None]
    begun = jnp.take_along_axis(logged.accel, first, axis=1)
    excused = logged.accel
    if world.walks is not None:
        walks = rows(world.walks)[:, None]
        begun = jnp.where(walks, _begun_on_foot(logged.accel, first, bounds, world.dt), begun)
        first = jnp.where(walks, first - 1, first)  # a mean over some steps binds no single step
        excused = jnp.where(walks, begun, excused)
    accel = _eased(controls.accel, excused, first, begun, bounds, world.dt)
    speed = stopping_speed(rows(world.start.speed), jnp.where(moving, accel, 0.0) * world.dt)
    if not (world.walks is None and world.cycles is None):
        # Pedestrians and cyclists have top speeds; they stop gaining speed at once, however jerk eases it off.
        speed = _computed_once(speed)
        slower = jnp.minimum(speed, rows(world.top_speed)[:, None])
        too_fast = moving & (speed[:, 1:] > slower[:, 1:])
        accel = jnp.where(too_fast, jnp.minimum(accel, jnp.diff(slower) / world.dt), accel)
        speed = slower
    as_logged = jnp.abs(logged.curvature) * midway(rows(world.log.speed)) ** 2
    lateral = jnp.maximum(bounds.lateral_accel[:, None], as_logged)
    tightest = lateral / jnp.maximum(midway(speed) ** 2, SLOWEST_TURN_M_S**2)
    if world.walks is None:
        return ControlArrays(accel, jnp.clip(controls.curvature, -tightest, tightest))
    walks = rows(world.walks)[:, None]
    tightest = jnp.where(walks, _fastest_turn(bounds, speed), tightest)
    held = ControlArrays(accel, jnp.clip(controls.curvature, -tightest, tightest))
    there_yet = walks & _not_left(controls, logged)
    return jax.tree.map(lambda own, log: jnp.where(there_yet, log, own), held, logged)


def _fastest_turn(bounds: DriveBounds, speed: Float[Array, "searched time"]) -> Float[Array, "searched step"]:
    """The fastest turn of a pedestrian as a curvature [1/m], from its lateral acceleration, speed times turn rate.

    A pedestrian slower than `SLOWEST_TURN_M_S` turns as if it went that fast.
    """
    pace = TURN_PACE_M_S * jnp.maximum(midway(speed), SLOWEST_TURN_M_S)
    return STEADY_TURN * bounds.lateral_accel[:, None] / pace


def _not_left(controls: ControlArrays, logged: ControlArrays) -> Bool[Array, "searched step"]:
    """The steps before the first at which the controls are not those of the log."""
    (accel, curvature), steps = _AS_LOGGED, controls.accel.shape[1]
    left = jnp.abs(controls.accel - logged.accel) > accel
    left |= jnp.abs(controls.curvature - logged.curvature) > curvature
    first = jnp.where(left.any(axis=1), jnp.argmax(left, axis=1), steps)
    return jnp.arange(steps) < first[:, None]


def _begun_on_foot(
    logged: Float[Array, "searched step"], first: Int[Array, "searched 1"], bounds: DriveBounds, dt: Float[Array, ""]
) -> Float[Array, "searched 1"]:
    """The mean of the first accelerations of a log [m/s^2], as single steps of a pedestrian may be extreme."""
    steps = jnp.arange(logged.shape[1])
    begins = (steps >= first) & (steps < first + jnp.maximum(steps_of(jnp, ACCEL_WINDOW_S, dt), 1))
    mean = (logged * begins).sum(axis=1, keepdims=True) / begins.sum(axis=1, keepdims=True)
    return jnp.clip(mean, -bounds.braking[:, None], bounds.accel[:, None])


def _computed_once(speed: Float[Array, "searched time"]) -> Float[Array, "searched time"]:
    """The same values, computed only once: XLA recomputes them for every use, but not across a matrix product."""
    return speed @ np.eye(speed.shape[1], dtype=speed.dtype)


def _eased(
    accel: Float[Array, "searched step"],
    logged: Float[Array, "searched step"],
    first: Int[Array, "searched 1"],
    begun: Float[Array, "searched 1"],
    bounds: DriveBounds,
    dt: Float[Array, ""],
) -> Float[Array, "searched step"]:
    """Accelerations clipped, and smoothed to the allowed jerk over any second, from `begun` at step `first` on.

    The allowed difference between the accelerations of two steps is a metric on the steps. The result is the mean of
    the least function above and the greatest below that keep to it (McShane 1934); no other has a smaller greatest
    difference from the clipped accelerations.
    """
    steps = jnp.arange(accel.shape[1], dtype=jnp.float32)
    since = jnp.maximum(_may_change(jnp.abs(steps - first) * dt, bounds.jerk[:, None]), jnp.abs(logged - begun))
    most = jnp.maximum(jnp.minimum(bounds.accel[:, None], begun + since), logged)
    least = jnp.minimum(jnp.maximum(-bounds.braking[:, None], begun - since), logged)
    clipped = jnp.clip(accel, least, most)[:, None]
    by_jerk = _may_change(jnp.abs(steps[:, None] - steps) * dt, bounds.jerk[:, None, None])
    apart = jnp.maximum(by_jerk, jnp.abs(logged[:, :, None] - logged[:, None, :]))
    return 0.5 * ((clipped + apart).min(axis=2) + (clipped - apart).max(axis=2))


def _may_change(within_s: Float[Array, "..."], jerk: Float[Array, "..."]) -> Float[Array, "..."]:
    """The allowed change of acceleration [m/s^2] within some seconds.

    It is the jerk times one second for each second begun, and at no time faster than in an emergency. So the means of
    two successive seconds differ by no more, and `handling` measures the jerk of traffic in that way.
    """
    whole = jnp.maximum(jnp.ceil(within_s / MEAN_S - _ROUNDING) - 1.0, 0.0)
    at_once = jnp.maximum(jerk, AT_ONCE_M_S3)
    return whole * jerk * MEAN_S + jnp.minimum(at_once * (within_s - whole * MEAN_S), jerk * MEAN_S)
