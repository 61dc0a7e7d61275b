"""The likelihood of the attacked motion in ordinary traffic, as a term of the cost."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.world import World
from regents_cosim.verdicts.handling import MEAN_S, felt_from
from regents_cosim.verdicts.usualness import VEHICLES, square_effort

_SMALLEST = 1e-6  # square of an effort, below which its root has no gradient worth having


def unlikeliness(world: World, motion: Motion, searched: SearchedAgents) -> Float[Array, ""]:
    """How unlikely the peak efforts of the searched motor vehicles are in ordinary traffic [nats], summed.

    The peak efforts of drives are log-normal (`usualness`): a peak above their median m counts
    (ln(peak / m) / spread)^2 / 2, the negative logarithm of its density beside that of m; a smaller one nothing. The
    peak is that of the whole drive, whereas `usualness` knows the contact and ends there.
    """
    valid, own = searched.rows(world.valid), searched.rows(motion)
    steps = jnp.round(MEAN_S / world.dt).astype(jnp.int32)
    begins = jnp.clip(jnp.arange(valid.shape[-1]), 0, jnp.maximum(valid.shape[-1] - 1 - 2 * steps, 0))
    seen = jnp.cumsum(jnp.pad(valid, ((0, 0), (1, 0))), axis=-1)
    whole = seen[:, begins + 2 * steps + 1] - seen[:, begins] == 2 * steps + 1
    efforts = square_effort(jnp, VEHICLES.most, *felt_from(jnp, begins, own.speed, own.yaw, steps, world.dt))
    peak = jnp.sqrt(jnp.where(whole, efforts, 0.0).max(axis=-1, initial=_SMALLEST))
    above = jnp.maximum(jnp.log(peak / VEHICLES.median), 0.0) / VEHICLES.spread
    return jnp.where(searched.rows(searched.candidate & world.vehicle), 0.5 * above**2, 0.0).sum()
