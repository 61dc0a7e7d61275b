"""The attack as in the public ReGentS code where that departs from its paper, to compare the two.

The methods `king-code` and `regents-code` take these functions in place of the paper's. Every departure that concerns
the attack:

- distances are squared and between centres, of the ego (`ego_distance`) and of pairs, whose cost is NaN where only one
agent may attack (`pair_proximity`)
- the road cost is read in one square, transposed, and summed over time (`road_deviation`)
- rule 1 has a wider yaw window and counts invalid steps (`diverging_in_front`), rules 2 and 3 count invalid steps with
a filler of -1 (`candidates`)
- actions are in m/s^2 and 1/m, and ReGentS halves the steps of steering (`in_physical_units`)
- braking continues past standstill (`roll_out_background`)
- agents that come late start from the filler and never join their log; when a log ends, its agent drives on, which the
costs do not see but the overlap test does (`stage`)
- hits by agents that may not attack do not stop the search (`optimised_only`), so tracks without a success can hold
one; the record of a success names the first contact, with any road user

These need no code: the search ignores an adversary that leaves the road or hits others first, which also holds for the
paper's version here (except for clean success), and the gradient leaves the ego alone. Left out: without an agent to
attack the public code dies, here the outcome stays `no_candidate`. These are not part of the attack: how the neural
planner brakes, steers and sees, the state of its controller between scenarios, and an interpreted loop. Everything
else, such as limits of the actions or which overlaps of the log are masked, is as in the paper's version.
"""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from regents_cosim.attacks.accept import rules
from regents_cosim.attacks.accept.acceptance import ego_contacts
from regents_cosim.attacks.descent.actions import to_actions, to_controls
from regents_cosim.attacks.descent.costs import Costs
from regents_cosim.attacks.descent.search_state import Rollout
from regents_cosim.attacks.descent.step import Descent
from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.geometry.boxes import same_level
from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.mirror.road_field import MARGIN_M
from regents_cosim.mirror.rollout import as_scripted, drive, with_ego
from regents_cosim.mirror.separation import Box, corners, overlaps
from regents_cosim.mirror.world import World
from regents_cosim.norms.limits import ACCEL_LIMIT, CURVATURE_LIMIT
from regents_cosim.scenario import Scenario

_FILLER = -1.0  # value of every field of an invalid state
_CROP_M = 16.0
_YAW_WINDOW_RAD = np.pi / 2


def total_cost(world: World, motion: Motion, candidate: Bool[Array, " agent"], config: AttackConfig) -> Costs:
    """The weighted sum of the three terms along `motion`, ego in row 0, with the paper's weights."""
    ego = ego_distance(world, motion, candidate)
    pair = pair_proximity(world, motion, candidate, config.cost.pair_reach_m)
    road = road_deviation(world, motion)
    return Costs(ego, pair, road, ego + config.cost.pair_weight * pair + config.cost.road_weight * road)


def ego_distance(world: World, motion: Motion, candidate: Bool[Array, " agent"]) -> Float[Array, ""]:
    """The ego distance: min over candidates of the mean *squared* distance of *centres* [m^2], over logged steps."""
    squares = (motion.x - motion.x[0]) ** 2 + (motion.y - motion.y[0]) ** 2
    z, counts = world.height(motion), world.valid
    if z is not None:
        counts &= same_level(z, z[:1])
        candidate &= counts.any(axis=1)
    means = jnp.where(counts, squares, 0.0).sum(axis=1) / jnp.maximum(counts.sum(axis=1), 1)
    return jnp.where(candidate, means, jnp.inf).min()


def pair_proximity(world: World, motion: Motion, candidate: Bool[Array, " agent"], reach_m: float) -> Float[Array, ""]:
    """C_adv_col: squared distances of centres clipped at tau^2 [m^2]; NaN where there is only one candidate.

    The gradient is exactly 0 unless two centres are within tau = 1.25 m; then the boxes already overlap.
    """
    background = jnp.arange(candidate.shape[0]) > 0
    pairs = jnp.triu(world.apart & (candidate[:, None] | candidate[None]) & background[:, None], k=1)
    counts = pairs[..., None] & world.valid[:, None] & world.valid[None]
    z = world.height(motion)
    if z is not None:
        counts &= same_level(z[:, None], z[None])
    squares = (motion.x[:, None] - motion.x[None]) ** 2 + (motion.y[:, None] - motion.y[None]) ** 2
    closest = -jnp.minimum(jnp.where(counts, squares, jnp.inf).min(), reach_m**2)
    return jnp.where(candidate.sum() == 1, jnp.nan, closest)


def road_deviation(world: World, motion: Motion) -> Float[Array, ""]:
    """C_adv_dev, with the map cropped at its own corner instead of the box's, [y, x] read as [x, y], and without 1/T.

    So it is 0 except in one square of 16 x 16 m, here the one at the `_corner`.
    """
    boxes = jax.tree.map(lambda values: values[1:], world.boxes(motion))
    left, bottom = _corner(world)
    total = jnp.float32(0.0)
    for corner, (x, y) in enumerate(zip(*corners(boxes), strict=True)):
        along, up = x - left, y - bottom
        inside = (along >= 0.0) & (along < _CROP_M) & (up >= 0.0) & (up < _CROP_M)
        counted = inside & world.valid[1:] & world.on_road[corner, 1:, None]
        total += jnp.where(counted, world.road(left + up, bottom + along, boxes.z), 0.0).sum()
    return total


def _corner(world: World) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The corner [m] where the map of a scene begins: the least x and y of the log, less a margin."""
    x, y = (jnp.where(world.valid, logged, jnp.inf).min() - MARGIN_M for logged in (world.log.x, world.log.y))
    return x, y


def diverging_in_front(motion: Motion) -> Bool[Array, " agent"]:
    """Rule 1, in which yaws up to pi/2 count, bearings up to pi/8 as in the paper, and also invalid steps."""
    ego, every = jax.tree.map(lambda values: values[0], motion), jnp.ones(motion.x.shape, bool)
    return rules.diverging_in_front(ego, motion, every, _YAW_WINDOW_RAD)


def candidates(world: World, config: AttackConfig) -> Bool[Array, " agent"]:
    """Rules 2 and 3, in which invalid steps count, with the filler as a place like any other.

    So an agent that comes late or leaves early is never static, and can leave the sector behind the ego.
    """
    unruled = config.but(exclude_rear=False, exclude_static=False)
    filled = dataclasses.replace(stage(world), valid=jnp.ones_like(world.valid))
    return rules.candidates(world, unruled) & rules.candidates(filled, config)


def in_physical_units(steps: ControlArrays, config: AttackConfig) -> ControlArrays:
    """Adam's steps, taken as m/s^2 and 1/m, as shares of the limits.

    Adam ignores the scale of an action, so this equals a search in these units. ReGentS, recognised by its rule 1,
    halves the steps of steering.
    """
    halved = 0.5 if config.rules.cancel_front_steering else 1.0
    return ControlArrays(steps.accel / ACCEL_LIMIT, halved * steps.curvature / CURVATURE_LIMIT)


def roll_out_background(world: World, controls: ControlArrays) -> Motion:
    """Motion that brakes past standstill, so that agents creep backwards. No agent waits for its log.

    Saved tracks, whose speeds are never negative, hold 0 there.
    """
    speed = _accumulate(world.start.speed, controls.accel * world.dt)
    travelled = 0.5 * (speed[:, :-1] + speed[:, 1:]) * world.dt
    yaw = _accumulate(world.start.yaw, controls.curvature * travelled)
    mid = 0.5 * (yaw[:, :-1] + yaw[:, 1:])
    x = _accumulate(world.start.x, travelled * jnp.cos(mid))
    y = _accumulate(world.start.y, travelled * jnp.sin(mid))
    return as_scripted(world, Motion(x, y, yaw, speed))


def stage(world: World) -> World:
    """The world with late agents and ended logs as in the public code.

    Where a log is invalid it holds the filler, also as the start of agents that come late, and no agent acts outside
    its log. From its first logged step on an agent is present to the end, for the planner and the overlap test; costs
    use `valid` of `world` itself.

    The position of the filler is relative to the `_corner`: the origin of a SUMO network may lie in the middle of its
    junction, where a filler would be run over.
    """
    x, y = (least + _FILLER for least in _corner(world))
    filler = Motion(x, y, jnp.full_like(x, _FILLER), jnp.full_like(x, _FILLER))
    last = world.valid.shape[1] - 1 - jnp.argmax(world.valid[:, ::-1], axis=1)
    driven = world.moving & (jnp.arange(world.moving.shape[1]) < last[:, None])
    return dataclasses.replace(
        world,
        log=jax.tree.map(lambda own, fill: jnp.where(world.valid, own, fill), world.log, filler),
        start=jax.tree.map(lambda own, fill: jnp.where(world.valid[:, 0], own, fill), world.start, filler),
        controls=jax.tree.map(lambda own: jnp.where(driven, own, 0.0), world.controls),
        valid=jnp.cumsum(world.valid, axis=1) > 0,
    )


def stay(scenario: Scenario) -> Scenario:
    """The counterpart of `stage` on the host: agents stay present to the end, whatever their log."""
    there = np.logical_or.accumulate(scenario.tracks.valid, axis=1)
    return dataclasses.replace(scenario, tracks=dataclasses.replace(scenario.tracks, valid=there))


def optimised_only(world: World, motion: Motion, candidate: Bool[Array, " agent"]) -> World:
    """The world for the test of hits that stop the search: only candidates, without those that appear on the ego."""
    boxes = world.boxes(motion)
    met = overlaps(jax.tree.map(lambda values: values[:1], boxes), boxes)
    at_entry = met[jnp.arange(candidate.shape[0]), jnp.argmax(world.valid, axis=1)]
    return dataclasses.replace(world, valid=world.valid & (candidate & ~at_entry)[:, None])


def _accumulate(start: Float[Array, " agent"], increments: Float[Array, "agent step"]) -> Float[Array, "agent time"]:
    return jnp.cumsum(jnp.concatenate([start[:, None], increments], axis=1), axis=1)


class PublishedDescent(Descent):
    """The descent with these functions instead of the paper's; all candidates are searched together."""

    def logged(self) -> ControlArrays:
        """The actions that reproduce the log where there is one."""
        return to_actions(stage(self.world).controls)

    def drive(self, actions: ControlArrays, memory: Any) -> tuple[Motion, ControlArrays, Any]:
        """Every agent's motion [agent time], the ego's controls [step] and the planner's memory at the end."""
        others = roll_out_background(stage(self.world), to_controls(actions))
        seen = others if self.config.steps.gradient == "through-planner" else jax.lax.stop_gradient(others)
        ego, controls, last = drive(self.planner, memory, stage(self.world), seen)
        return with_ego(others, ego), controls, last

    def gradient(self, actions: ControlArrays, seen: Rollout) -> tuple[Float[Array, ""], Costs, ControlArrays]:
        """The cost, its terms and its gradient, by differentiating the roll-out as a whole."""
        (total, costs), gradient = jax.value_and_grad(self.cost_through_planner, has_aux=True)(actions)
        return total, costs, gradient

    def terms(self, boxes: Box, motion: Motion) -> Costs:
        """The terms of the cost."""
        return total_cost(self.world, motion, self.searched.candidate, self.config)

    def steps(self, steps: ControlArrays) -> ControlArrays:
        """Adam's steps as shares of the limits."""
        return in_physical_units(steps, self.config)

    def may_steer(self, seen: Rollout) -> Bool[Array, " searched"]:
        """Searched agents whose steering is updated (rule 1)."""
        if not self.config.rules.cancel_front_steering:
            return jnp.ones_like(self.searched.candidate)
        return ~diverging_in_front(seen.motion)

    def hit(self, seen: Rollout) -> Bool[Array, ""]:
        """Whether an optimised agent meets the ego."""
        judged = optimised_only(stage(self.world), seen.motion, self.searched.candidate)
        return ego_contacts(judged, seen.boxes).any()
