"""The three terms of the attack's cost, each with its equation of the ReGentS paper, and how unlikely a motion is.

A minimum is found without gradient and only its argument is differentiated: the same gradient as that of the hard
minimum, for one distance instead of thousands.
"""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.attacks.methods.presets import KING, AttackConfig
from regents_cosim.geometry.boxes import same_level
from regents_cosim.geometry.frames import along_and_left
from regents_cosim.geometry.lines import steps_along
from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.lookup import look_up, rows_of
from regents_cosim.mirror.separation import Box, corners, distance, first_row, pick
from regents_cosim.mirror.world import World
from regents_cosim.norms.limits import STANDING_M_S
from regents_cosim.verdicts.handling import felt_from, mean_steps
from regents_cosim.verdicts.usualness import VEHICLES, square_effort

_NEVER_M = 1e4  # distance of an agent that is never drawn to the ego
_SMALLEST = 1e-6  # square of an effort, below which its root has no gradient worth having
_BEHIND_RAD = 0.75 * np.pi  # bearing from the ego beyond which another is behind


class Costs(eqx.Module):
    """The values of the terms; `total` is what the descent lowers."""

    ego: Float[Array, ""]  # [m] C_ego_col
    pair: Float[Array, ""]  # [m] C_adv_col, never positive
    road: Float[Array, ""]  # C_adv_dev
    total: Float[Array, ""]


def total_cost(world: World, boxes: Box, searched: SearchedAgents, config: AttackConfig) -> Costs:
    """C = C_ego_col + lambda_col C_adv_col + lambda_dev C_adv_dev (section 3.2), with the ego in row 0 of `boxes`.

    C_ego_col = min over candidates i of (1/T) sum_k d_BB(0, i, k) [m] (eq. 4), pooled as in `pooled_ego_distances`;
    without candidates the value is meaningless. C_adv_col = - min over pairs i < j of background agents and k of
    min(tau, d_BB(i, j, k)) [m], over the pairs of `_closest_pair`.

    Both distances are computed in one place, because two places take twice as long to compile.
    """
    found = jax.lax.stop_gradient(boxes)
    adversary = _nearest_candidate(world, found, searched, config)
    i, j, step = _closest_pair(world, found, searched, config.cost.pair_reach_m)
    ours, theirs = pick(boxes, jnp.stack([jnp.int32(0), i])), pick(boxes, jnp.stack([adversary, j]))
    to_ego, between = distance(ours, theirs)
    pulls = _pulls(world, look_up(world.valid, adversary)[None], first_row(ours), first_row(theirs), config)
    ego = _pool(to_ego, pulls[0], config.cost.softmin_m)
    pair = -jnp.where(i == j, config.cost.pair_reach_m, jnp.minimum(look_up(between, step), config.cost.pair_reach_m))
    road = road_deviation(world, boxes, searched)
    return Costs(ego, pair, road, ego + config.cost.pair_weight * pair + config.cost.road_weight * road)


def pooled_ego_distances(world: World, boxes: Box, config: AttackConfig = KING) -> Float[Array, " agent"]:
    """The distance of every agent to the ego, pooled over time [m].

    It is the mean over the steps at which an agent is valid; with `softmin_m` a soft minimum instead, and without
    `pull_from_behind` the steps at which the agent is behind the ego are left out.
    """
    ego = first_row(boxes)
    return _pool(distance(ego, boxes), _pulls(world, world.valid, ego, boxes, config), config.cost.softmin_m)


def road_deviation(world: World, boxes: Box, searched: SearchedAgents) -> Float[Array, ""]:
    """C_adv_dev = (1/T) sum_k sum_i sum over the corners c of i of (m_oob * K)(c), over the searched agents i.

    Corners that are off the road at the agent's first step are left out. Other agents would only add a constant.
    """
    agents, steps = world.valid.shape
    background = searched.rows(world.valid & (jnp.arange(agents) > 0)[:, None])
    boxes, on_road = searched.rows(boxes), searched.rows(world.on_road.T)
    return jnp.where(background & on_road.T[:, :, None], world.allowed(*corners(boxes), boxes.z), 0.0).sum() / steps


def _nearest_candidate(world: World, boxes: Box, searched: SearchedAgents, config: AttackConfig) -> Int[Array, ""]:
    """The candidate with the least pooled distance to the ego."""
    if searched.count == 1:
        return searched.first
    distances = jnp.where(searched.candidate, pooled_ego_distances(world, boxes, config), jnp.inf)
    return jnp.argmin(distances).astype(jnp.int32)


def _closest_pair(
    world: World, boxes: Box, searched: SearchedAgents, reach_m: float
) -> tuple[Int[Array, ""], Int[Array, ""], Int[Array, ""]]:
    """The closest pair of background agents as (i, j, step); i == j where none comes within reach.

    Pairs that overlap when both are first present in the log are left out, and so are pairs of which neither may
    change: such constants would hide the others in the minimum.
    """
    agents = world.valid.shape[0]
    background = jnp.arange(agents) > 0
    if searched.count == 1:
        mine = pick(boxes, searched.first[None])
        counts = look_up(world.apart, searched.first) & background & (jnp.arange(agents) != searched.first)
        counts = counts[:, None] & world.valid & look_up(world.valid, searched.first)
        exact = jnp.where(counts, distance(mine, boxes), jnp.inf)
        j, step = _argmin(exact)
        j, step = j.astype(jnp.int32), step.astype(jnp.int32)
        return jnp.where(exact[j, step] < reach_m, searched.first, j), j, step
    counts = jnp.triu(world.apart & (searched.candidate[:, None] | searched.candidate) & background[:, None], k=1)
    full = jax.tree.map(lambda values: jnp.broadcast_to(values, boxes.x.shape), boxes)
    return _closest_of(counts, world.valid, full, reach_m)


class _Closest(eqx.Module):
    """The closest pair so far, and lower bounds of the distances of other pairs."""

    bounds: Float[Array, " pair"]  # [m] lower bounds; infinite once a pair has been measured
    distance: Float[Array, ""]  # [m]
    i: Int[Array, ""]
    j: Int[Array, ""]
    step: Int[Array, ""]


def _closest_of(
    counts: Bool[Array, "agent agent"], valid: Bool[Array, "agent time"], boxes: Box, reach_m: float
) -> tuple[Int[Array, ""], Int[Array, ""], Int[Array, ""]]:
    """The closest of the pairs that count.

    Circles around the boxes bound every distance from below. Exact distances are computed for as many pairs at a time
    as there are agents, the least bounds first, until the rest is too far away; in the densest traffic about as many
    pairs come within reach.
    """
    agents = valid.shape[0]

    def nearer(best: _Closest) -> _Closest:
        pairs = jax.lax.top_k(-best.bounds, agents)[1]
        i, j = pairs // agents, pairs % agents
        exact = distance(*(rows_of(boxes, a) for a in (i, j)))
        together = look_up(counts.reshape(-1), pairs)[:, None] & look_up(valid, i) & look_up(valid, j)
        exact = jnp.where(together, exact, jnp.inf)
        pair, step = _argmin(exact)
        left = best.bounds.at[pairs].set(jnp.inf)
        found = _Closest(left, exact[pair, step], i[pair], j[pair], step.astype(jnp.int32))
        kept = replace(best, bounds=left)
        return jax.tree.map(lambda new, old: jnp.where(found.distance < best.distance, new, old), found, kept)

    none_yet = jnp.int32(0)
    reach = jnp.asarray(reach_m, boxes.x.dtype)
    best = _Closest(_lower_bounds(counts, valid, boxes), reach, none_yet, none_yet, none_yet)
    best = jax.lax.while_loop(lambda now: now.bounds.min() < now.distance, nearer, best)
    return best.i, best.j, best.step


def _lower_bounds(
    counts: Bool[Array, "agent agent"], valid: Bool[Array, "agent time"], boxes: Box
) -> Float[Array, " pair"]:
    """Lower bounds of the least distance over time [m] of pairs, from circles; infinite for pairs that do not count."""
    together = valid[:, None] & valid[None]
    squares = (boxes.x[:, None] - boxes.x[None]) ** 2 + (boxes.y[:, None] - boxes.y[None]) ** 2
    centres = jnp.sqrt(jnp.where(together, squares, jnp.inf).min(axis=2))
    radius = jnp.hypot(boxes.half_length[:, 0], boxes.half_width[:, 0])
    return jnp.where(counts, centres - radius[:, None] - radius[None], jnp.inf).reshape(-1)


def _argmin(values: Float[Array, "row time"]) -> tuple[Int[Array, ""], Int[Array, ""]]:
    """Row and column of the least value; two steps are faster than one over the flat array."""
    row = jnp.argmin(values.min(axis=1))
    return row, jnp.argmin(look_up(values, row))


def _pulls(
    world: World, valid: Bool[Array, "*agent time"], ego: Box, boxes: Box, config: AttackConfig
) -> Bool[Array, "*agent time"]:
    """Steps at which the ego draws an agent: on the same level, and by `config` not from behind or while it stands."""
    pulls = valid if boxes.z is None else valid & same_level(ego.z, boxes.z)
    if not config.cost.pull_from_behind:
        dx, dy = boxes.x - ego.x, boxes.y - ego.y
        pulls &= along_and_left(dx, dy, ego.cos, ego.sin)[0] >= np.cos(_BEHIND_RAD) * jnp.hypot(dx, dy)
    if not config.cost.pull_standing:
        speed = steps_along(ego.x, ego.y, jnp) / world.dt
        pulls &= jnp.concatenate([speed[:, :1], speed], axis=1) > STANDING_M_S
    return pulls


def _pool(
    values: Float[Array, "*axes time"], counts: Bool[Array, "*axes time"], softmin_m: float
) -> Float[Array, "*axes"]:
    """The mean of `values` over the steps that count, or their soft minimum; very large where none counts."""
    number = counts.sum(axis=-1)
    if softmin_m == 0.0:
        pooled = jnp.where(counts, values, 0.0).sum(axis=-1) / jnp.maximum(number, 1)
    else:
        weighed = jnp.where(counts, -values / softmin_m, -_NEVER_M)
        pooled = -softmin_m * (jax.nn.logsumexp(weighed, axis=-1) - jnp.log(jnp.maximum(number, 1)))
    return jnp.where(number > 0, pooled, _NEVER_M)


def unlikeliness(world: World, motion: Motion, searched: SearchedAgents) -> Float[Array, ""]:
    """How unlikely the peak efforts of the searched motor vehicles are in ordinary traffic [nats], summed.

    The peak efforts of drives are log-normal (`usualness`): a peak above their median m counts
    (ln(peak / m) / spread)^2 / 2, the negative logarithm of its density beside that of m; a smaller one nothing. The
    peak is that of the whole drive, whereas `usualness` knows the contact and ends there.
    """
    valid, own = searched.rows(world.valid), searched.rows(motion)
    steps = mean_steps(jnp, world.dt)
    begins = jnp.clip(jnp.arange(valid.shape[-1]), 0, jnp.maximum(valid.shape[-1] - 1 - 2 * steps, 0))
    seen = jnp.cumsum(jnp.pad(valid, ((0, 0), (1, 0))), axis=-1)
    whole = seen[:, begins + 2 * steps + 1] - seen[:, begins] == 2 * steps + 1
    efforts = square_effort(jnp, VEHICLES.most, *felt_from(jnp, begins, own.speed, own.yaw, steps, world.dt))
    peak = jnp.sqrt(jnp.where(whole, efforts, 0.0).max(axis=-1, initial=_SMALLEST))
    above = jnp.maximum(jnp.log(peak / VEHICLES.median), 0.0) / VEHICLES.spread
    return jnp.where(searched.rows(searched.candidate & world.vehicle), 0.5 * above**2, 0.0).sum()
