"""How agents that are held up drive around: by a change of lanes, and by a swerve where braking is not enough.

Lane changes follow MOBIL (Kesting, Treiber and Helbing 2007): an agent changes where it gains more acceleration than
the agent behind it loses, weighed by politeness, and no agent behind has to brake hard. The swerve is a reflex: it
comes once the agent has braked for as long as a driver takes to act (UN R157), where braking cannot end the approach
any more, and stays on the lanes of its direction.
"""

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.mirror.logged_way import LoggedWay
from regents_cosim.mirror.lookup import look_up, rows_of
from regents_cosim.mirror.reactions.bodies import Along, Bodies, along_arcs
from regents_cosim.mirror.reactions.following import ACCEL, BRAKE, FAR_M, SIDE_MARGIN_M, gaps_ahead, in_way, pressure
from regents_cosim.mirror.reactions.state import Reacting
from regents_cosim.norms.careful import CAREFUL
from regents_cosim.norms.limits import ACCEL_LIMIT, SAME_WAY_COS

_POLITENESS = 0.3
_GAIN = 0.2  # [m/s^2] of acceleration that makes a lane change worth it
_SAFE_BRAKING = 4.0  # [m/s^2] of the agent behind
_CHANGE_M_S2, _CHANGE_M_S = 1.5, 1.5  # across the lanes
_SWERVE_M_S = 3.0
_SLIP = 0.3  # drift for each speed forward, at most
_LANE_LASTS_S = 2.0  # a lane that ends sooner is none to change to
_HASTE = 2.0  # [1/s] of the drift for each metre that is left


def move_aside(
    state: Reacting, mine: Bodies, seen: Bodies, bend: Float[Array, " agent"],
    wanted: Float[Array, " agent"], decides: Bool[Array, ""], room: LoggedWay, dt: Float[Array, ""],
) -> Reacting:  # fmt: skip
    """The state with a new drift and place beside the path, `dt` [s] later, and a new aim where the agents decide.

    They are at `mine`, along their paths, on arcs of curvature `bend` [1/m]; `wanted` [m/s] is the speed of their log.
    """
    chooses = jnp.where(decides & _has_a_choice(state, room, dt), 1.0 + state.held_up, 0.0)

    def choose(now: tuple[Array, Array]) -> tuple[Array, Array]:
        left, aim = now
        row = jnp.argmax(left)
        chosen, here = _aims(row[None], state, mine, seen, bend, wanted, room, dt), seen.index == row
        return jnp.where(here, 0.0, left), jnp.where(here, chosen, aim)

    _, aim = jax.lax.while_loop(lambda now: (now[0] > 0.0).any(), choose, (chooses, state.aim))
    hurries = state.needed > BRAKE
    most = jnp.minimum(jnp.where(hurries, _SWERVE_M_S, _CHANGE_M_S), _SLIP * state.speed)
    towards = jnp.clip(_HASTE * (aim - state.left), -most, most)
    most_change = jnp.where(hurries, CAREFUL.swerve_m_s2, _CHANGE_M_S2) * dt
    drift = jnp.clip(state.drift + jnp.clip(towards - state.drift, -most_change, most_change), -most, most)
    return dataclasses.replace(state, aim=aim, drift=drift, left=state.left + drift * dt)


def _has_a_choice(state: Reacting, room: LoggedWay, dt: Float[Array, ""]) -> Bool[Array, " agent"]:
    """Which agents may get another aim: the cheap part of the conditions in `_aims`."""
    left_lane, right_lane, _, _ = _room(jnp.arange(len(state.aim)), state, room, dt)
    beside = (left_lane != 0.0) | (right_lane != 0.0)
    may_change, must_swerve = _urge(state)
    return (state.aim != 0.0) | may_change & beside | must_swerve


def _urge(state: Reacting) -> tuple[Bool[Array, " agent"], Bool[Array, " agent"]]:
    """Which agents have been held up for so long that they may change lanes, never in haste, or have to swerve."""
    late = state.held_up >= CAREFUL.delay_s
    return late & (state.needed < BRAKE), late & (state.needed > ACCEL_LIMIT)


def _aims(
    rows: Int[Array, " chosen"], state: Reacting, mine: Bodies, all_: Bodies, bend: Float[Array, " agent"],
    wanted: Float[Array, " agent"], room: LoggedWay, dt: Float[Array, ""],
) -> Float[Array, " chosen"]:  # fmt: skip
    """Where the agents of some rows drive to [m left of their paths]."""
    state, mine = rows_of((state, mine), rows)
    bend, (left_lane, right_lane, left_m, right_m) = look_up(bend, rows), _room(rows, state, room, dt)
    here = along_arcs(mine, bend, all_)
    now, _ = _accelerations(here, mine, all_)
    around_left, around_right, leads = _around(here, mine, all_, state.left)

    lanes = jnp.stack([left_lane, -right_lane])
    around = jnp.stack([around_left, around_right])
    home = jnp.zeros_like(lanes[:1])

    @jax.vmap
    def at(
        aim: Float[Array, " chosen"], speed: Float[Array, " chosen"]
    ) -> tuple[Float[Array, " chosen"], Float[Array, " chosen"]]:
        left = aim - state.left
        there = dataclasses.replace(mine, x=mine.x - left * mine.sin, y=mine.y + left * mine.cos, speed=speed)
        return _accelerations(along_arcs(there, bend, all_), there, all_)

    # Home is free for an agent only at the speed that it wants to reach.
    speeds = jnp.stack([*[mine.speed] * 4, look_up(wanted, rows)])
    ahead, behind = at(jnp.concatenate([lanes, around, home]), speeds)
    in_lanes, past, at_home = slice(0, 2), slice(2, 4), 4
    may_change, must_swerve = _urge(state)
    aim = jnp.where((state.aim != 0.0) & _is_free(ahead[at_home], behind[at_home]), 0.0, state.aim)

    gain = jnp.where(lanes != 0.0, _gain(now, ahead[in_lanes], behind[in_lanes]), 0.0)
    # Only for one that drives its way, and only from its path.
    changes = may_change & leads & (state.aim == 0.0) & (gain.max(axis=0) > _GAIN)
    aim = jnp.where(changes, jnp.where(gain[0] >= gain[1], *lanes), aim)

    within = (around <= left_m) & (around >= -right_m)
    open_ = within & (ahead[past] > now) & (behind[past] > -ACCEL_LIMIT)
    way_m = jnp.where(open_, jnp.abs(around - state.left), jnp.inf)
    swerves = must_swerve & open_.any(axis=0)
    return jnp.where(swerves, jnp.where(way_m[0] <= way_m[1], *around), aim)


def _is_free(ahead: Float[Array, " chosen"], behind: Float[Array, " chosen"]) -> Bool[Array, " chosen"]:
    """Whether an agent is not held up at a place, and no agent behind it there; both are accelerations [m/s^2]."""
    return (ahead >= ACCEL) & (behind > -_SAFE_BRAKING)


def _gain(
    now: Float[Array, " chosen"], ahead: Float[Array, "side chosen"], behind: Float[Array, "side chosen"]
) -> Float[Array, "side chosen"]:
    """What a lane change is worth [m/s^2] by MOBIL, from the accelerations now and there; 0 where it is not safe."""
    return jnp.where(behind > -_SAFE_BRAKING, ahead - now + _POLITENESS * jnp.minimum(behind, 0.0), 0.0)


def _room(
    rows: Int[Array, " chosen"], state: Reacting, room: LoggedWay, dt: Float[Array, ""]
) -> tuple[Float[Array, " chosen"], ...]:
    """The room of some agents at their places [m]: to the lane on the left and on the right, and to either side.

    The way to a lane is 0 where there is none now or soon.
    """
    last = room.left.shape[1] - 1
    now = jnp.clip(jnp.round(state.step), 0.0, last).astype(jnp.int32)
    soon = jnp.clip(jnp.round(state.step + _LANE_LASTS_S / dt), 0.0, last).astype(jnp.int32)

    def lane(to_lane: Float[Array, "agent time"]) -> Float[Array, " chosen"]:
        return jnp.where(look_up(to_lane, (rows, soon)) > 0.0, look_up(to_lane, (rows, now)), 0.0)

    left, right = (look_up(side, (rows, now)) for side in (room.left, room.right))
    return lane(room.to_left_lane), lane(room.to_right_lane), left, right


def _accelerations(along: Along, mine: Bodies, all_: Bodies) -> tuple[Float[Array, " chosen"], Float[Array, " chosen"]]:
    """The acceleration [m/s^2] that each agent is left with, and the lowest of those behind it."""
    gap, closing = gaps_ahead(along, mine, all_)
    tightest = pressure(mine.speed[:, None], gap, closing).max(axis=1)
    behind = in_way(along, mine) & (along.ahead <= 0.0)
    room_behind = jnp.where(behind, -along.ahead - along.reach - mine.half_length[:, None], FAR_M)
    from_behind = pressure(all_.speed[None], room_behind, all_.speed[None] - mine.speed[:, None] * along.same)
    return ACCEL * (1.0 - tightest), ACCEL * (1.0 - from_behind.max(axis=1))


def _around(
    along: Along, mine: Bodies, all_: Bodies, left: Float[Array, " chosen"]
) -> tuple[Float[Array, " chosen"], Float[Array, " chosen"], Bool[Array, " chosen"]]:
    """How far left of its path each agent passes the tightest agent in its way, on either side of it [m].

    The third value tells whether that one drives the agent's way.
    """
    gap, closing = gaps_ahead(along, mine, all_)
    tightest = jnp.argmax(pressure(mine.speed[:, None], gap, closing), axis=1)[:, None]
    middle, breadth, same = (
        jnp.take_along_axis(values, tightest, axis=1)[:, 0] for values in (along.left, along.breadth, along.same)
    )
    beside = breadth + mine.half_width + 2.0 * SIDE_MARGIN_M
    return left + middle + beside, left + middle - beside, same > SAME_WAY_COS
