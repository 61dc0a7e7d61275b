"""Decide on the device whether a collision that the search has made says something about the planner.

The checks are those of `regents_cosim.verdicts.clean`, made for every collision that a descent comes across, since a
flawed one does not end it. They are as strict as the verdict on the host or slightly stricter, except for rare cases
that take long to compute and that the host decides:

- what happens between two steps: the area that a body sweeps, and third parties that it passes through;
- other road users that collide with each other;
- islands and verges less than 1.6 m wide, which the blurred map hardly shows;
- corners that began more than 1 m off the road and go further away: the blurred map is flat there.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.attacks.accept.careful_driver import careful_avoids
from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.mirror.bicycle import Motion, running_minimum
from regents_cosim.mirror.lookup import look_up
from regents_cosim.mirror.separation import Box, corners, first_row, gap, overlaps, pick
from regents_cosim.mirror.world import World
from regents_cosim.norms import clean as rules
from regents_cosim.norms import limits

# Value of the blurred map (`road_field`) on a straight edge of the road. It is stricter than the host, which lets
# corners be 0.3 m off: beyond a narrow median the blurred map is lower.
_OFF_ROAD = 0.5
_FURTHER_OFF = 0.02  # a corner that began off the road may raise its field value by this much
_TOUCH_BAND_M = 1e-3
# A hit in float32 must also be a hit for the exact check on the host.
_HIT_DEPTH_M = 1e-3


def is_clean(
    world: World, searched: SearchedAgents, motion: Motion, boxes: Box, hits: Bool[Array, "agent time"]
) -> Bool[Array, ""]:
    """Whether the first of the ego's contacts `hits` along `motion` has no flaw; row 0 is the ego."""
    step = jnp.argmax(hits.any(axis=0))
    agent = jnp.argmax(hits[:, step])
    ego, adversary = (jax.tree.map(lambda values: values[0], some) for some in (boxes, pick(boxes, agent[None])))
    there = look_up(world.valid, agent)
    so_far = there & (jnp.arange(there.shape[0]) <= step)
    clean = (
        look_up(searched.candidate, agent)
        & (searched.continues | _moved(world, adversary, agent, so_far))
        & (motion.speed[0, step] >= limits.STANDING_M_S)
        & ~_from_behind(ego, adversary, there, step, world.dt)
        & ~_too_hard(world, motion, agent, there, so_far)
        & ~(so_far & _off_road(world, adversary, agent, so_far)).any()
        & ~(so_far & _touches_others(world, boxes, adversary, agent)).any()
    )
    if world.walks is None:
        return clean
    spoilt = _spoilt_on_foot(world, motion, ego, adversary, agent, there, step)
    return clean & ~(look_up(world.walks, agent) & spoilt)


# --- what the adversary does by itself and with the ego ------------------------------------------


def _moved(world: World, box: Box, agent: Int[Array, ""], so_far: Bool[Array, " time"]) -> Bool[Array, ""]:
    away = jnp.hypot(box.x - look_up(world.log.x, agent), box.y - look_up(world.log.y, agent))
    return (so_far & (away > limits.MOVED_M)).any()


def _from_behind(
    ego: Box, adversary: Box, there: Bool[Array, " time"], step: Int[Array, ""], dt: Float[Array, ""]
) -> Bool[Array, ""]:
    """Whether the adversary hits the rear face in the ego's direction, or the rear part after following it."""
    ahead = (adversary.x - ego.x) * ego.cos + (adversary.y - ego.y) * ego.sin
    turn_cos = look_up(ego.cos * adversary.cos + ego.sin * adversary.sin, step)
    met_at = _met_at(ego, adversary, there, step)
    before = look_up(ahead, rules.behind_since(jnp, there, step, dt))
    came = rules.comes_from_behind(met_at, before, ego.half_length[0])
    return rules.rear_ends_ego(turn_cos, met_at, look_up(ahead, step)) | came


def _met_at(ego: Box, other: Box, there: Bool[Array, " time"], step: Int[Array, ""]) -> Float[Array, ""]:
    """`CrashTracks.met_at` on the device: the place of first touch along the ego, as a share from its rear end."""
    steps = rules.last_step(jnp, there, step)
    poses = jnp.stack([jnp.stack([box.x, box.y, box.cos, box.sin]) for box in (ego, other)])[..., steps]
    share = np.linspace(0.0, 1.0, limits.SUB_STEPS + 1, dtype=np.float32)
    x, y, cos, sin = jnp.moveaxis(poses[..., :1] + jnp.diff(poses) * share, 1, 0)
    norm = jnp.hypot(cos, sin)  # headings go along the chord, which differs by less than a thousandth
    half = (jnp.stack(sides) for sides in ((ego.half_length, other.half_length), (ego.half_width, other.half_width)))
    pair = Box(x, y, cos / norm, sin / norm, *half)
    first = jnp.argmax(overlaps(*(jax.tree.map(lambda v, row=row: v[row], pair) for row in (0, 1))))
    x, y, cos, sin = jnp.stack([pair.x, pair.y, pair.cos, pair.sin])[..., first]
    return rules.contact_share(jnp, x, y, cos, sin, pair.half_length[:, 0], pair.half_width[:, 0])


def _too_hard(
    world: World, motion: Motion, agent: Int[Array, ""], there: Bool[Array, " time"], so_far: Bool[Array, " time"]
) -> Bool[Array, ""]:
    """Whether the hardest acceleration up to the contact exceeds the limit and that of the whole log."""
    speed, yaw = (
        jnp.stack([look_up(now, agent), look_up(log, agent)])
        for now, log in ((motion.speed, world.log.speed), (motion.yaw, world.log.yaw))
    )
    needed, in_log = rules.hardest(jnp, speed, yaw, jnp.stack([so_far, there]), world.dt)
    most = limits.MOST_ACCEL_M_S2
    if world.walks is not None:
        most = jnp.where(look_up(world.walks, agent), limits.MOST_WALKING_M_S2, most)
    return (needed < 0.0) | rules.harder_than(jnp, needed, most, in_log)


def _spoilt_on_foot(
    world: World, motion: Motion, ego: Box, adversary: Box,
    agent: Int[Array, ""], there: Bool[Array, " time"], step: Int[Array, ""],
) -> Bool[Array, ""]:  # fmt: skip
    """Whether the pedestrian has stood for a second, met the rear, or run into the side by itself.

    Its speed is not checked, as the attack bounds it.
    """
    steps, pair = rules.last_step(jnp, there, step), (ego, adversary)
    poses = [jnp.stack([getattr(box, name)[steps] for box in pair]) for name in ("x", "y", "cos", "sin")]
    sizes = ([getattr(box, name)[0] for box in pair] for name in ("half_length", "half_width"))
    aside, front = rules.met_face(jnp, *poses, *sizes)
    stood = rules.stood(jnp, look_up(motion.speed, agent), there, step, world.dt)
    return stood | jnp.where(aside, rules.closes_in(jnp, *poses, dt=world.dt), ~front)


# --- what it does to the road and to others ------------------------------------------------------


def _off_road(world: World, box: Box, agent: Int[Array, ""], so_far: Bool[Array, " time"]) -> Bool[Array, " time"]:
    """At which steps a corner is off the road; corners that began off it may be off it, but not go further away.

    A pedestrian may be anywhere, or wherever its own map allows.
    """
    began_on = look_up(world.on_road.T, agent)
    fields = world.allowed(*corners(box), box.z)
    least = running_minimum(jnp.where(so_far, fields, jnp.inf), jnp.inf)
    reach = jnp.where(began_on[:, None], _OFF_ROAD, jnp.maximum(_OFF_ROAD, least + _FURTHER_OFF))
    off = (fields > reach).any(axis=0)
    return off if world.walks is None or world.own_road is not None else off & ~look_up(world.walks, agent)


def _touches_others(world: World, boxes: Box, box: Box, agent: Int[Array, ""]) -> Bool[Array, " time"]:
    """At which steps it touches an agent that it did not overlap at first; the host also excuses log touches."""
    index = jnp.arange(boxes.x.shape[0])
    others = look_up(world.apart, agent) & (index > 0) & (index != agent)
    return (others[:, None] & world.valid & overlaps(box, boxes, -_TOUCH_BAND_M)).any(axis=0)


def ego_contacts(world: World, boxes: Box) -> Bool[Array, "agent time"]:
    """Where the ego's box overlaps another's (eq. 2); False for the ego itself.

    Pairs that overlap at first, in the log or with the ego as it drives now, are left out.
    """
    ego = first_row(boxes)
    counts = world.valid & world.apart[0][:, None]
    appears = jnp.argmax(world.valid, axis=1)[:, None]
    between = gap(ego, boxes)
    began_so = jnp.take_along_axis(between, appears, axis=1) <= 0.0
    return counts & ~began_so & (between <= -_HIT_DEPTH_M)


def is_wanted(
    world: World,
    searched: SearchedAgents,
    motion: Motion,
    boxes: Box,
    contacts: Bool[Array, "agent time"],
    config: AttackConfig,
) -> Bool[Array, ""]:
    """Whether the first of the ego's `contacts` has no flaw, and a careful driver avoids it if `config` asks so."""
    clean = is_clean(world, searched, motion, boxes, contacts)
    if config.acceptance.accept != "telling" or world.lanes is None:
        return clean
    lanes, step = world.lanes, jnp.argmax(contacts.any(axis=0))
    agent = jnp.argmax(contacts[:, step])
    return jax.lax.cond(
        clean, lambda: careful_avoids(world, motion, boxes, lanes, agent, step), lambda: jnp.asarray(False)
    )
