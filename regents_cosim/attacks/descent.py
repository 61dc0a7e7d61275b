"""The search: roll out, look for a collision, differentiate, mask, Adam, again.

One compiled loop per scenario. It stops at the first collision of the ego with any background
agent, or when the iterations are spent. Source: ReGentS section 3.2 (and KING section 3).
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.attacks.costs import Costs, total_cost
from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.attacks.rules import diverging_in_front
from regents_cosim.mirror.bicycle import ACCEL_LIMIT, CURVATURE_LIMIT, Controls, Motion
from regents_cosim.mirror.dynamics import controls_between
from regents_cosim.mirror.rollout import (
    LoopPlanner,
    drive,
    drive_among_reacting,
    roll_out_background,
    with_ego,
)
from regents_cosim.mirror.separation import overlaps
from regents_cosim.mirror.world import World

# Whatever else a user wants of the scenario, as a cost to be lowered: smooth, in the cost's units.
ExtraCost = Callable[[World, Motion, Controls], Float[Array, ""]]

# A hit in float32 must be one for the exact judge on the host as well.
_HIT_DEPTH_M = 1e-3


class Found(eqx.Module):
    """What an attack ended with."""

    motion: Motion  # [agent time] last roll-out, ego in row 0
    controls: Controls  # [agent step] that made it, the ego's own in row 0
    changed: Bool[Array, " agent"]  # the attack moved this agent's controls
    hit: Bool[Array, ""]
    finite: Bool[Array, ""]
    any_candidate: Bool[Array, ""]
    iterations: Int[Array, ""]  # updates made
    history: Float[Array, "iteration term"]  # ego, pair and road cost before each update


class _Search(eqx.Module):
    actions: Float[Array, "agent step 2"]  # accel and curvature as shares of their limits
    adam: optax.OptState
    motion: Motion
    ego_controls: Controls
    hit: Bool[Array, ""]
    finite: Bool[Array, ""]
    iterations: Int[Array, ""]
    history: Float[Array, "iteration term"]


@eqx.filter_jit
def descend(
    world: World,
    planner: LoopPlanner,
    memory: Any,
    config: AttackConfig,
    candidate: Bool[Array, " agent"],
    extra_cost: ExtraCost | None = None,
) -> Found:
    """Attack `planner` (with its `memory` of the scene) in `world` with the controls of `candidate` agents."""
    reacting = world.vehicle & ~candidate
    logged = to_actions(world.controls)
    adam = optax.adam(config.learning_rate, config.beta1, config.beta2)

    def roll_out(actions: Array) -> tuple[Motion, Controls]:
        background = roll_out_background(world, to_controls(actions))
        if config.background == "reactive":
            return drive_among_reacting(planner, memory, world, background, reacting)
        ego, ego_controls = drive(planner, memory, world, background)
        return with_ego(background, ego), ego_controls

    def cost(actions: Array, seen: Motion) -> tuple[Float[Array, ""], Costs]:
        if config.gradient == "through-planner":
            motion, _ = roll_out(actions)
        else:
            background = roll_out_background(world, to_controls(actions))
            motion = jax.tree.map(lambda own, fixed: jnp.where(candidate[:, None], own, fixed), background, seen)
        costs = total_cost(world, motion, candidate, config)
        extra = extra_cost(world, motion, to_controls(actions)) if extra_cost else 0.0
        return costs.total + extra, costs

    def evaluate(search: _Search) -> _Search:
        motion, ego_controls = roll_out(search.actions)
        return eqx.tree_at(
            lambda s: (s.motion, s.ego_controls, s.hit),
            search,
            (motion, ego_controls, ego_is_hit(world, motion)),
        )

    def update(search: _Search) -> _Search:
        (_, costs), gradient = jax.value_and_grad(cost, has_aux=True)(search.actions, search.motion)
        steps, state = adam.update(gradient, search.adam)
        steps = jnp.where(may_change(search.motion), jnp.asarray(steps), 0.0)
        terms = jnp.stack([costs.ego, costs.pair, costs.road])
        finite = jnp.isfinite(gradient).all() & jnp.isfinite(terms).all()
        return evaluate(
            _Search(
                actions=within_bounds(search.actions + steps, logged, search.motion.speed, config),
                adam=state,
                motion=search.motion,
                ego_controls=search.ego_controls,
                hit=search.hit,
                finite=finite,
                iterations=search.iterations + 1,
                history=search.history.at[search.iterations].set(terms),
            )
        )

    def may_change(motion: Motion) -> Bool[Array, "agent #step 2"]:
        steers = candidate
        if config.cancel_front_steering:
            steers &= ~diverging_in_front(motion, world.valid, config.front_share, config.front_window_rad)
        return jnp.stack([candidate, steers], axis=-1)[:, None]

    def goes_on(search: _Search) -> Bool[Array, ""]:
        return ~search.hit & search.finite & (search.iterations < config.iterations) & candidate.any()

    begin = _Search(
        actions=logged,
        adam=adam.init(logged),
        motion=world.log,
        ego_controls=jax.tree.map(lambda values: values[0], world.controls),
        hit=jnp.asarray(False),
        finite=jnp.asarray(True),
        iterations=jnp.int32(0),
        history=jnp.zeros((config.iterations, 3), jnp.float32),
    )
    end = jax.lax.while_loop(goes_on, update, evaluate(begin))
    controls = to_controls(end.actions)
    if config.background == "reactive":
        moved = controls_between(world.dynamics, end.motion, world.dt)
        controls = jax.tree.map(lambda own, seen: jnp.where(reacting[:, None], seen, own), controls, moved)
    controls = jax.tree.map(lambda all_, own: all_.at[0].set(own), controls, end.ego_controls)
    finite = end.finite & jnp.isfinite(end.motion.x).all() & jnp.isfinite(end.motion.y).all()
    changed = (jnp.abs(end.actions - logged) > 1e-6).any(axis=(1, 2))
    return Found(end.motion, controls, changed, end.hit, finite, candidate.any(), end.iterations, end.history)


def within_bounds(
    actions: Float[Array, "agent step 2"],
    logged: Float[Array, "agent step 2"],
    speed: Float[Array, "agent time"],
    config: AttackConfig,
) -> Float[Array, "agent step 2"]:
    """The nearest actions that the configuration allows; logged ones always are."""
    low, high = jnp.full_like(actions, -1.0), jnp.full_like(actions, 1.0)
    if config.max_deviation > 0.0:
        low, high = logged - config.max_deviation, logged + config.max_deviation
    if config.max_lateral_accel > 0.0:
        tightest = config.max_lateral_accel / (CURVATURE_LIMIT * jnp.maximum(speed[:, :-1], 1.0) ** 2)
        tightest = jnp.maximum(tightest, jnp.abs(logged[..., 1]))
        low = low.at[..., 1].max(-tightest)
        high = high.at[..., 1].min(tightest)
    return jnp.clip(jnp.clip(actions, low, high), -1.0, 1.0)


def ego_is_hit(world: World, motion: Motion) -> Bool[Array, ""]:
    """Whether the ego's box overlaps another's at some step (eq. 2), pairs that began so left out."""
    boxes = world.boxes(motion)
    ego = jax.tree.map(lambda values: values[:1], boxes)
    counts = world.valid & world.apart[0][:, None]
    return (counts & overlaps(ego, boxes, _HIT_DEPTH_M))[1:].any()


def to_actions(controls: Controls) -> Float[Array, "agent step 2"]:
    """Controls as shares of the mirror's limits."""
    return jnp.stack([controls.accel / ACCEL_LIMIT, controls.curvature / CURVATURE_LIMIT], axis=-1)


def to_controls(actions: Float[Array, "agent step 2"]) -> Controls:
    """The inverse of `to_actions`."""
    return Controls(actions[..., 0] * ACCEL_LIMIT, actions[..., 1] * CURVATURE_LIMIT)
