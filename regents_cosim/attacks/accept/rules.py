"""Choose the agents that may attack, and those that may not steer: the three rules of ReGentS, section 3.3."""

import functools

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.geometry.boxes import CLEARANCE_M
from regents_cosim.mirror.bicycle import Motion, wrap
from regents_cosim.mirror.world import World
from regents_cosim.scenario.road_users import RoadUser

FRONT_SHARE = 0.5  # share of the steps in the red zone that cancels steering (tau_front)
FRONT_WINDOW_RAD = np.pi / 8  # how far the bearing from the ego and the heading differ from its own in the red zone
REAR_SHARE = 0.8  # share of the steps in the sector behind the ego from which on one is excluded
REAR_SECTOR_RAD = np.pi / 4  # full width of that sector
_STATIC_M = 0.2  # distance over the horizon below which an agent stands


def candidates(world: World, config: AttackConfig) -> Bool[Array, " agent"]:
    """Agents whose controls the attack may change.

    These are road users of the configured kinds, except the ego, that are present for at least half of the horizon, do
    not overlap the ego at first, share a height with it and drive without jumps, and that rules 2 and 3 do not exclude.
    Both rules use the log alone, and so apply to pedestrians as well: none catches up with a car from behind.
    """
    not_ego = jnp.arange(world.valid.shape[0]) > 0
    long_enough = world.valid.mean(axis=1) >= 0.5
    allowed = (
        not_ego
        & of_kinds(world, config.candidates.adversary_kinds)
        & long_enough
        & world.apart[0]
        & may_meet_ego(world)
    )
    if world.scripted is not None:
        allowed &= ~world.scripted
    if config.rules.exclude_rear:
        allowed &= ~mostly_behind(world)
    if config.rules.exclude_static:
        allowed &= travelled(world) >= _STATIC_M
    return allowed


def of_kinds(world: World, kinds: tuple[RoadUser, ...]) -> Bool[Array, " agent"]:
    """Which agents are of the given kinds."""
    masks = {"vehicle": world.vehicle, "cyclist": world.cycles, "pedestrian": world.walks}
    chosen = [mask for kind in kinds if (mask := masks[kind]) is not None]
    return functools.reduce(jnp.logical_or, chosen) if chosen else jnp.zeros(world.valid.shape[0], bool)


def may_meet_ego(world: World) -> Bool[Array, " agent"]:
    """Agents that in the log, at some step, are within the clearance of a height that the ego has at some step."""
    if world.heights is None:
        return jnp.ones(world.valid.shape[0], bool)
    z, ego = world.heights.z, world.heights.z[0]
    meets = (z > ego.min() - CLEARANCE_M) & (z < ego.max() + CLEARANCE_M)
    return (meets & world.valid).any(axis=1)


def mostly_behind(world: World) -> Bool[Array, " agent"]:
    """Rule 2: agents that in the log are in the sector behind the ego for most (`REAR_SHARE`) of their steps."""
    log = world.log
    bearing = jnp.arctan2(log.y - log.y[0], log.x - log.x[0])
    off_axis = wrap(bearing - log.yaw[0] - jnp.pi)
    behind = world.valid & (jnp.abs(off_axis) < 0.5 * REAR_SECTOR_RAD)
    return behind.sum(axis=1) > REAR_SHARE * world.valid.sum(axis=1)


def travelled(world: World) -> Float[Array, " agent"]:
    """Rule 3: the length of the logged path over the valid steps [m]."""
    both = world.valid[:, 1:] & world.valid[:, :-1]
    steps = jnp.hypot(jnp.diff(world.log.x, axis=1), jnp.diff(world.log.y, axis=1))
    return jnp.where(both, steps, 0.0).sum(axis=1)


def diverging_in_front(ego: Motion, agents: Motion, valid: Bool[Array, "agent time"]) -> Bool[Array, " agent"]:
    """Rule 1: agents in the red zone around `ego` [time] for more than half of the valid steps of the roll-out.

    With alpha the bearing of agent i from the ego, dyaw = wrap(yaw_i - yaw_0) and dalpha = wrap(alpha - yaw_0), the red
    zone is |dyaw| < pi/8, |dalpha| < pi/8 and 0 < dalpha / dyaw < 1: ahead, to one side, and turned away to the same
    side, so that any pull towards the ego's future path turns it further away.
    """
    cos, sin = jnp.cos(ego.yaw), jnp.sin(ego.yaw)
    dx, dy = agents.x - ego.x, agents.y - ego.y
    ahead, left = dx * cos + dy * sin, dy * cos - dx * sin
    turn_cos, turn_sin = jnp.cos(agents.yaw - ego.yaw), jnp.sin(agents.yaw - ego.yaw)
    # Within a right angle, angles compare like their tangents: no arc tangent and no wrapping is needed.
    narrow = (turn_cos > np.cos(FRONT_WINDOW_RAD)) & (jnp.abs(left) < np.tan(FRONT_WINDOW_RAD) * ahead)
    same_side = (left * turn_sin > 0.0) & (jnp.abs(left) * turn_cos < jnp.abs(turn_sin) * ahead)
    red = valid & narrow & same_side
    return red.sum(axis=1) > FRONT_SHARE * valid.sum(axis=1)
