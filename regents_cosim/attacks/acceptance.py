"""Whether a collision that the search has made tells something about the planner.

The same questions as `regents_cosim.verdicts.clean` asks of a finished case, here on the device for every collision
that a descent comes across: one that is spoilt does not end it. What is accepted here is strictly clean there; the
other way round this is stricter by little:

- the road ends 2 cm earlier, as its distances come from a grid, and no point of the outline may be further off it
  than that, where the host allows the body to sweep 0.05 m^2;
- boxes that come within 1 mm of a third party touch it.

What takes little time is asked first; the road and the others only of what is left.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.attacks.costs import take
from regents_cosim.attacks.movers import Movers
from regents_cosim.limits import (
    ABOVE_LOG_M_S2,
    ACCEL_WINDOW_S,
    ALONG_RAD,
    FROM_BEHIND_S,
    MOST_ACCEL_M_S2,
    MOVED_M,
    OFF_ROAD_M,
    REAR_FACE,
    REAR_PART,
    STANDING_M_S,
    SUB_STEPS,
)
from regents_cosim.mirror.bicycle import Motion, accumulate, running_minimum
from regents_cosim.mirror.lookup import look_up
from regents_cosim.mirror.separation import Box, corners, overlaps
from regents_cosim.mirror.world import World

_ROAD_BAND_M = 0.02
_TOUCH_BAND_M = 1e-3
_PARALLEL_M = 1e-6  # an edge that goes less far along an axis is parallel to the other one

# Points of the outline as shares of the half sizes, along and across: eight on either side, three more at each end.
_SIDE, _END = np.linspace(-1.0, 1.0, 8), np.array([-0.5, 0.0, 0.5])
_OUTLINE = np.concatenate(
    [[(along, side) for along in _SIDE] for side in (-1.0, 1.0)] + [[(end, x) for x in _END] for end in (-1.0, 1.0)]
)


def is_clean(
    world: World, movers: Movers, motion: Motion, boxes: Box, hits: Bool[Array, "agent time"]
) -> Bool[Array, ""]:
    """Whether nothing spoils the first of the ego's contacts `hits` along `motion`; the ego in row 0."""
    step = jnp.argmax(hits.any(axis=0))
    agent = jnp.argmax(hits[:, step])
    ego, adversary = _row(boxes, jnp.int32(0)), _row(boxes, agent)
    there = take(world.valid, agent)
    so_far = there & (jnp.arange(there.shape[0]) <= step)
    by_itself = (
        take(movers.candidate, agent)
        & _moved(world, adversary, agent, so_far)
        & (motion.speed[0, step] >= STANDING_M_S)
        & ~_from_behind(ego, adversary, there, step, world.dt)
        & ~_too_hard(world, motion, agent, there, so_far, step)
    )
    return jax.lax.cond(
        by_itself,
        lambda: (
            ~_leaves_road(world, adversary, so_far)
            & ~_touches_others(world, boxes, adversary, agent, so_far)
            & ~_bystanders_collide(world, boxes, agent, step)
        ),
        lambda: jnp.asarray(False),
    )


# --- what the adversary does by itself and with the ego ------------------------------------------


def _moved(world: World, box: Box, agent: Int[Array, ""], so_far: Bool[Array, " time"]) -> Bool[Array, ""]:
    away = jnp.hypot(box.x - look_up(world.log.x, agent), box.y - look_up(world.log.y, agent))
    return (so_far & (away > MOVED_M)).any()


def _from_behind(
    ego: Box, adversary: Box, there: Bool[Array, " time"], step: Int[Array, ""], dt: Float[Array, ""]
) -> Bool[Array, ""]:
    """Into the rear face the same way, or into the rear part by one that was behind a second before."""
    ahead = (adversary.x - ego.x) * ego.cos + (adversary.y - ego.y) * ego.sin
    since = jnp.maximum(step - jnp.round(FROM_BEHIND_S / dt).astype(jnp.int32), 0)
    since = jnp.argmax(there & (jnp.arange(there.shape[0]) >= since))
    same_way = look_up(ego.cos * adversary.cos + ego.sin * adversary.sin, step) > np.cos(ALONG_RAD)
    met_at = _met_at(ego, adversary, there, step)
    into_back = same_way & (met_at < REAR_FACE) & (look_up(ahead, step) < 0.0)
    return into_back | ((met_at < REAR_PART) & (look_up(ahead, since) < -ego.half_length[0]))


def _met_at(ego: Box, other: Box, there: Bool[Array, " time"], step: Int[Array, ""]) -> Float[Array, ""]:
    """`Crash.met_at`: where on the ego it is met at the first touch, a share of its length from the rear end."""
    before = jnp.maximum(step - 1, 0)
    before = jnp.where(look_up(there, before), before, step)
    steps = jnp.stack([before, step])
    a, b = (_finer(jax.tree.map(lambda v: look_up(v, steps), box)) for box in (ego, other))
    first = jnp.argmax(overlaps(a, b))
    return _contact_share(*(jax.tree.map(lambda v: look_up(v, first), box) for box in (a, b)))


def _contact_share(ego: Box, other: Box) -> Float[Array, ""]:
    """The middle of what two boxes share, along the first: the edges of each cut to the other (Liang and Barsky)."""
    low, high = jnp.inf, -jnp.inf
    for box, mate in ((ego, other), (other, ego)):
        x, y = corners(mate)
        ahead = (x - box.x) * box.cos + (y - box.y) * box.sin
        left = (y - box.y) * box.cos - (x - box.x) * box.sin
        begin, end = jnp.zeros(4), jnp.ones(4)
        for at, half in ((ahead, box.half_length), (left, box.half_width)):
            way = _next(at) - at
            way = jnp.where(jnp.abs(way) < _PARALLEL_M, _PARALLEL_M, way)
            enters, leaves = (-half - at) / way, (half - at) / way
            begin, end = jnp.maximum(begin, jnp.minimum(enters, leaves)), jnp.minimum(end, jnp.maximum(enters, leaves))
        along = (x - ego.x) * ego.cos + (y - ego.y) * ego.sin
        cut = along + jnp.stack([begin, end]) * (_next(along) - along)
        low = jnp.minimum(low, jnp.where(begin <= end, cut, jnp.inf).min())
        high = jnp.maximum(high, jnp.where(begin <= end, cut, -jnp.inf).max())
    return 0.5 + 0.25 * (low + high) / ego.half_length


def _next(values: Float[Array, " corner"]) -> Float[Array, " corner"]:
    return jnp.roll(values, -1)


def _too_hard(
    world: World,
    motion: Motion,
    agent: Int[Array, ""],
    there: Bool[Array, " time"],
    so_far: Bool[Array, " time"],
    step: Int[Array, ""],
) -> Bool[Array, ""]:
    """`clean.hardest` of the adversary up to the contact, against that of its whole log."""
    speed, yaw = (
        jnp.stack([look_up(now, agent), look_up(log, agent)])
        for now, log in ((motion.speed, world.log.speed), (motion.yaw, world.log.yaw))
    )
    last = jnp.stack([step, jnp.int32(speed.shape[1] - 1)])
    needed, in_log = _hardest(speed, yaw, jnp.stack([so_far, there]), last[:, None], world.dt)
    return needed > jnp.maximum(MOST_ACCEL_M_S2, in_log + ABOVE_LOG_M_S2)


def _hardest(
    speed: Float[Array, "track time"],
    yaw: Float[Array, "track time"],
    there: Bool[Array, "track time"],
    last: Int[Array, "track 1"],
    dt: Float[Array, ""],
) -> Float[Array, " track"]:
    index = jnp.arange(speed.shape[1])
    window = jnp.maximum(jnp.round(ACCEL_WINDOW_S / dt).astype(jnp.int32), 1)
    window = jnp.maximum(jnp.minimum(window, last), 1)
    end = jnp.minimum(index + window, speed.shape[1] - 1)
    nothing = jnp.zeros(len(speed))
    gone = accumulate(nothing, 0.5 * (speed[:, 1:] + speed[:, :-1]))
    gaps = accumulate(nothing, jnp.where(there[:, :-1], 0.0, 1.0))

    def over(values: Array) -> Array:
        return jnp.take_along_axis(values, end, axis=1, mode="promise_in_bounds") - values

    whole = (over(gaps) == 0.0) & jnp.take_along_axis(there, end, axis=1) & (index + window <= last)
    felt = jnp.hypot(over(speed), over(gone) * over(yaw) / window) / (window * dt)
    return jnp.where(whole, felt, 0.0).max(axis=1)


# --- what it does to the road and to others ------------------------------------------------------


def _leaves_road(world: World, box: Box, so_far: Bool[Array, " time"]) -> Bool[Array, ""]:
    """`verdicts.leaving_road` by points of the outline."""
    finer = _finer(box)
    along, across = (part[:, None] for part in jnp.asarray(_OUTLINE, box.x.dtype).T)
    along, across = along * finer.half_length, across * finer.half_width
    x = finer.x + along * finer.cos - across * finer.sin
    y = finer.y + along * finer.sin + across * finer.cos
    off = world.road.metres_off(x, y, finer.z)
    by_corner = jnp.stack([off[number, ::SUB_STEPS] for number in (0, 7, 8, 15)])
    nearest = jnp.maximum(running_minimum(jnp.where(so_far, by_corner, jnp.inf), jnp.inf), 0.0)
    reach = OFF_ROAD_M - _ROAD_BAND_M + nearest
    corner_off = (so_far & (by_corner > reach)).any()
    furthest = reach.max(axis=0)
    swept_off = _there_between(so_far) & (off > jnp.append(jnp.repeat(furthest[:-1], SUB_STEPS), furthest[-1]))
    return corner_off | swept_off.any()


def _touches_others(
    world: World, boxes: Box, box: Box, agent: Int[Array, ""], so_far: Bool[Array, " time"]
) -> Bool[Array, ""]:
    others = take(world.strangers, agent) & _others(world, agent)
    there = _there_between(world.valid) & _there_between(so_far)
    touched = overlaps(_finer(box), _finer(boxes), -_TOUCH_BAND_M)
    return (others[:, None] & there & touched).any()


def _bystanders_collide(world: World, boxes: Box, agent: Int[Array, ""], step: Int[Array, ""]) -> Bool[Array, ""]:
    others = _others(world, agent)
    pairs = world.strangers & others & others[:, None] & (world.vehicle | world.vehicle[:, None])
    there = world.valid & (jnp.arange(world.valid.shape[1]) <= step)
    mine, theirs = (jax.tree.map(lambda v, axis=axis: jnp.expand_dims(v, axis), boxes) for axis in (0, 1))
    return (pairs[..., None] & there & there[:, None] & overlaps(mine, theirs, -_TOUCH_BAND_M)).any()


def _others(world: World, agent: Int[Array, ""]) -> Bool[Array, " agent"]:
    index = jnp.arange(world.valid.shape[0])
    return (index > 0) & (index != agent)


# --- between the steps ---------------------------------------------------------------------------


def _row(boxes: Box, agent: Int[Array, ""]) -> Box:
    """The boxes [time] of one agent."""
    full = jax.tree.map(lambda v: jnp.broadcast_to(v, boxes.x.shape), boxes)
    return jax.tree.map(lambda v: look_up(v, agent), full)


def _finer(boxes: Box) -> Box:
    """`boxes.in_between` of boxes [... time]; headings go along the chord, which differs by less than a thousandth."""
    full = jax.tree.map(lambda v: jnp.broadcast_to(v, boxes.x.shape), boxes)
    share = np.arange(SUB_STEPS) / SUB_STEPS

    def between(values: Array) -> Array:
        ways = values[..., :-1, None] + jnp.diff(values)[..., None] * share
        return jnp.concatenate([ways.reshape(*values.shape[:-1], -1), values[..., -1:]], axis=-1)

    finer = jax.tree.map(between, full)
    length = jnp.hypot(finer.cos, finer.sin)
    return replace(finer, cos=finer.cos / length, sin=finer.sin / length)


def _there_between(there: Bool[Array, "*axes time"]) -> Bool[Array, "*axes instant"]:
    """`boxes.there_between`."""
    both = jnp.repeat((there[..., :-1] & there[..., 1:])[..., None], SUB_STEPS - 1, axis=-1)
    ways = jnp.concatenate([there[..., :-1, None], both], axis=-1)
    return jnp.concatenate([ways.reshape(*there.shape[:-1], -1), there[..., -1:]], axis=-1)
