"""The three terms of the attack's cost, each with its equation of the ReGentS paper.

A minimum is found without gradient and only the winner is differentiated: the gradient of a
hard minimum, at the price of one distance instead of thousands.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.attacks.presets import KING, AttackConfig
from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.separation import Box, corners, distance
from regents_cosim.mirror.world import World

_NEVER_M = 1e4  # the distance of an agent that is never drawn to the ego


class Costs(eqx.Module):
    """Values of the terms; `total` is what the descent lowers."""

    ego: Float[Array, ""]  # [m] C_ego_col
    pair: Float[Array, ""]  # [m] C_adv_col, never positive
    road: Float[Array, ""]  # C_adv_dev
    total: Float[Array, ""]


def total_cost(world: World, motion: Motion, candidate: Bool[Array, " agent"], config: AttackConfig) -> Costs:
    """C = C_ego_col + lambda_col C_adv_col + lambda_dev C_adv_dev (section 3.2) along `motion`, ego in row 0."""
    boxes = world.boxes(motion)
    ego = ego_distance(world, boxes, candidate, config)
    pair = pair_proximity(world, boxes, candidate, config.pair_reach_m)
    road = road_deviation(world, boxes)
    return Costs(ego, pair, road, ego + config.pair_weight * pair + config.road_weight * road)


def ego_distance(
    world: World, boxes: Box, candidate: Bool[Array, " agent"], config: AttackConfig = KING
) -> Float[Array, ""]:
    """C_ego_col = min over candidates i of (1/T) sum_k d_BB(0, i, k) [m] (eq. 4).

    The mean is over the steps at which i is valid. With `softmin_m` it is a soft minimum over
    time instead, and without `pull_from_behind` steps at which i is behind the ego are left out.
    Without candidates the value is meaningless.
    """
    nearest = jax.lax.stop_gradient(pooled_ego_distances(world, boxes, config))
    chosen = jnp.argmin(jnp.where(candidate, nearest, jnp.inf))
    pulls = _pulls(world, jax.tree.map(jax.lax.stop_gradient, boxes), config)[chosen]
    return _pool(distance(take(boxes, 0), take(boxes, chosen)), pulls, config.softmin_m)


def pooled_ego_distances(world: World, boxes: Box, config: AttackConfig = KING) -> Float[Array, " agent"]:
    """Distance to the ego pooled over time, for every agent [m]."""
    return _pool(distance(_ego(boxes), boxes), _pulls(world, boxes, config), config.softmin_m)


def pair_proximity(world: World, boxes: Box, candidate: Bool[Array, " agent"], reach_m: float) -> Float[Array, ""]:
    """C_adv_col = - min over pairs i < j of background agents and k of min(tau, d_BB(i, j, k)) [m].

    Pairs that overlap in the log when both are first there are left out, and so are pairs of
    which neither may change: they are constants that would hide the others in the minimum.
    """
    i, j, k = _closest_pair(world, jax.tree.map(jax.lax.stop_gradient, boxes), candidate)
    closest = distance(*(jax.tree.map(lambda values, a=a: values[a, k], _full(boxes)) for a in (i, j)))
    none_found = i == j
    return -jnp.where(none_found, reach_m, jnp.minimum(closest, reach_m))


def road_deviation(world: World, boxes: Box) -> Float[Array, ""]:
    """C_adv_dev = (1/T) sum_k sum_i sum over the corners c of i of (m_oob * K)(c).

    Corners that are off the road at the agent's first step are left out.
    """
    x, y = corners(jax.tree.map(lambda values: values[1:], boxes))
    counted = world.valid[1:] & world.on_road[:, 1:, None]
    return jnp.where(counted, world.road(x, y), 0.0).sum() / world.valid.shape[1]


def take(boxes: Box, agent: Int[Array, "*chosen"] | int) -> Box:
    """Boxes [*chosen, time] of some agents."""
    return jax.tree.map(lambda values: values[agent], boxes)


def _full(boxes: Box) -> Box:
    """Boxes whose fields all have the shape [agent, time]."""
    return jax.tree.map(lambda values: jnp.broadcast_to(values, boxes.x.shape), boxes)


def _closest_pair(
    world: World, boxes: Box, candidate: Bool[Array, " agent"]
) -> tuple[Int[Array, ""], Int[Array, ""], Int[Array, ""]]:
    """(i, j, step) of the closest pair of background agents, i == j where there is none.

    Circles around the boxes bound every distance from below; exact distances decide among the
    pairs with the least bounds, as many as there are agents. A pair within tau has a bound below
    tau, and only neighbours do: a vehicle has one or two in the densest traffic.
    """
    boxes, agents = _full(boxes), candidate.shape[0]
    background = jnp.arange(agents) > 0
    counts = jnp.triu(world.apart & (candidate[:, None] | candidate[None]) & background[:, None], k=1)
    together = world.valid[:, None] & world.valid[None]
    squares = (boxes.x[:, None] - boxes.x[None]) ** 2 + (boxes.y[:, None] - boxes.y[None]) ** 2
    centres = jnp.sqrt(jnp.where(together, squares, jnp.inf).min(axis=2))
    radius = jnp.hypot(world.half_length, world.half_width)
    bound = jnp.where(counts, centres - radius[:, None] - radius[None], jnp.inf)
    _, best = jax.lax.top_k(-bound.reshape(-1), agents)
    i, j = best // agents, best % agents
    exact = distance(take(boxes, i), take(boxes, j))
    exact = jnp.where(counts[i, j][:, None] & world.valid[i] & world.valid[j], exact, jnp.inf)
    pair, step = jnp.unravel_index(jnp.argmin(exact), exact.shape)
    found = jnp.isfinite(exact[pair, step])
    return jnp.where(found, i[pair], 0), jnp.where(found, j[pair], 0), step


def _pulls(world: World, boxes: Box, config: AttackConfig) -> Bool[Array, "agent time"]:
    """Steps at which an agent is drawn to the ego."""
    if config.pull_from_behind:
        return world.valid
    ego = _ego(boxes)
    dx, dy = boxes.x - ego.x, boxes.y - ego.y
    ahead, left = dx * ego.cos + dy * ego.sin, dy * ego.cos - dx * ego.sin
    return world.valid & (jnp.abs(jnp.arctan2(left, ahead)) <= config.behind_rad)


def _pool(
    values: Float[Array, "*axes time"], counts: Bool[Array, "*axes time"], softmin_m: float
) -> Float[Array, "*axes"]:
    """Mean of `values` over the time steps that count, or their soft minimum; far away where none counts."""
    number = counts.sum(axis=-1)
    if softmin_m == 0.0:
        pooled = jnp.where(counts, values, 0.0).sum(axis=-1) / jnp.maximum(number, 1)
    else:
        weighed = jnp.where(counts, -values / softmin_m, -_NEVER_M)
        pooled = -softmin_m * (jax.nn.logsumexp(weighed, axis=-1) - jnp.log(jnp.maximum(number, 1)))
    return jnp.where(number > 0, pooled, _NEVER_M)


def _ego(boxes: Box) -> Box:
    return jax.tree.map(lambda values: values[:1], boxes)
