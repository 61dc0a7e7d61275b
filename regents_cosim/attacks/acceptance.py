"""Whether a collision that the search has made tells something about the planner.

The same questions as `regents_cosim.verdicts.clean` asks of a finished case, by exact boxes, here on the device
for every collision that a descent comes across: one that is spoilt does not end it.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.attacks.costs import take
from regents_cosim.attacks.movers import Movers
from regents_cosim.limits import ALONG_RAD, STANDING_M_S
from regents_cosim.mirror.separation import Box, corners, first_row, overlaps, pick
from regents_cosim.mirror.world import World

# The blurred map (`road_field`) on a straight edge of the road. Stricter than the verdict on the host, which lets
# corners be 0.3 m off: beyond a narrow median the blurred map is lower.
_OFF_ROAD = 0.5


def is_clean(
    world: World,
    movers: Movers,
    boxes: Box,
    ego_speed: Float[Array, " time"],
    hits: Bool[Array, "agent time"],
) -> Bool[Array, ""]:
    """Whether nothing spoils the first of the ego's contacts `hits`; `boxes` [agent time], the ego in row 0.

    It is with an agent that the attack may change, which has stayed on the road and touched
    nobody else so far and does not run into the back of the ego; and the ego moves.
    """
    step = jnp.argmax(hits.any(axis=0))
    agent = jnp.argmax(hits[:, step])
    ego, adversary = first_row(boxes), pick(boxes, agent[None])
    so_far = take(world.valid, agent) & (jnp.arange(hits.shape[1]) <= step)
    return (
        take(movers.candidate, agent)
        & ~(so_far & _off_road(world, adversary, agent)).any()
        & ~(so_far & _touches_others(world, boxes, adversary, agent)).any()
        & ~_runs_into_back(ego, adversary, step)
        & (ego_speed[step] >= STANDING_M_S)
    )


def _off_road(world: World, box: Box, agent: Int[Array, ""]) -> Bool[Array, " time"]:
    began_on = take(world.on_road.T, agent)
    fields = began_on[:, None] * world.road(*corners(box), box.z)[:, 0]
    return fields.max(axis=0) > _OFF_ROAD


def _touches_others(world: World, boxes: Box, box: Box, agent: Int[Array, ""]) -> Bool[Array, " time"]:
    index = jnp.arange(boxes.x.shape[0])
    others = take(world.apart, agent) & (index > 0) & (index != agent)
    return (others[:, None] & world.valid & overlaps(box, boxes)).any(axis=0)


def _runs_into_back(ego: Box, adversary: Box, step: Int[Array, ""]) -> Bool[Array, ""]:
    """The rear-end collision of `collisions.collision_kind`, the adversary being behind."""
    before = jnp.maximum(step - 1, 0)
    same_way = _at(ego.cos * adversary.cos + ego.sin * adversary.sin, step) > np.cos(ALONG_RAD)
    dx, dy = _at(adversary.x - ego.x, before), _at(adversary.y - ego.y, before)
    cos, sin = _at(ego.cos, before), _at(ego.sin, before)
    ahead, left = dx * cos + dy * sin, dy * cos - dx * sin
    gap_along = jnp.abs(ahead) - _at(ego.half_length + adversary.half_length, step)
    gap_across = jnp.abs(left) - _at(ego.half_width + adversary.half_width, step)
    return same_way & (ahead < 0.0) & (gap_along >= gap_across)


def _at(values: Float[Array, "1 *time"], step: Int[Array, ""]) -> Float[Array, ""]:
    return jnp.broadcast_to(values, (1, values.shape[-1]))[0, jnp.minimum(step, values.shape[-1] - 1)]
