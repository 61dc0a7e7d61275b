"""One step of the agents that react: they follow the path of their log, and react only to agents that left theirs.

An agent that merely replays its log runs into an ego or an adversary that brakes where the log did not, and no driver
is to blame for that crash. A reacting agent drives at its logged speed or slower. No gradient passes through reactions.
"""

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.lookup import look_up, rows_of
from regents_cosim.mirror.programs.compiled import mapped_with
from regents_cosim.mirror.reactions.bodies import Bodies, along_arcs, bodies
from regents_cosim.mirror.reactions.following import ACCEL, STILL_M_S, gaps_ahead, pressure
from regents_cosim.mirror.reactions.giving_way import own_way, pressure_foreseen, way_of_other
from regents_cosim.mirror.reactions.moving_aside import move_aside
from regents_cosim.mirror.reactions.state import BackgroundInstant, Reacting, aside, at_step, neighbours
from regents_cosim.mirror.world import World
from regents_cosim.norms.following import braking_needed
from regents_cosim.norms.limits import ACCEL_LIMIT

_OFF_LOG_M = 0.3  # an agent further from its logged position counts as disturbed
_DECIDES_S = 0.2  # how often an agent looks at the others


def react(state: Reacting, now: Motion, own: Motion, instant: BackgroundInstant, world: World) -> Reacting:
    """The state of all agents one step later; at this one they are at `now` [agent].

    They follow `own` [agent time]. Where the world does not tell the ways of their log, they only brake for what is in
    their way now.
    """
    disturbed = instant.present & (jnp.hypot(now.x - instant.log.x, now.y - instant.log.y) > _OFF_LOG_M)
    before, _, _ = neighbours(own.x, state.step)
    curvature = world.controls.curvature
    bend = jnp.take_along_axis(curvature, jnp.minimum(before, curvature.shape[1] - 1)[:, None], axis=1)[:, 0]
    seen = bodies(now, world.half_length, world.half_width, world.height(now))
    on_path = now.yaw - aside(state)
    mine = dataclasses.replace(seen, cos=jnp.cos(on_path), sin=jnp.sin(on_path))
    turn = (now.yaw - state.yaw) / world.dt
    decides = jnp.mod(instant.index, jnp.maximum(jnp.round(_DECIDES_S / world.dt), 1.0)) == 0.0
    pressed, needed = jax.lax.cond(
        decides,
        lambda: _pressed_by(disturbed, mine, seen, bend, state, own, turn, world),
        lambda: (state.pressure, state.needed),
    )
    held_up = jnp.where(pressed > 1.0, state.held_up + world.dt, 0.0)
    later = dataclasses.replace(state, yaw=now.yaw, pressure=pressed, needed=needed, held_up=held_up)
    later = _driven_on(later, own, world.dt)
    if world.logged_way is not None:
        (wanted,) = at_step(later.step, own.speed)
        later = move_aside(later, mine, seen, bend, wanted, decides, world.logged_way, world.dt)
    # An agent that has not entered yet keeps pace with time.
    waiting = dataclasses.replace(state, step=state.step + 1.0, yaw=now.yaw)
    return jax.tree.map(lambda moved, kept: jnp.where(instant.moving, moved, kept), later, waiting)


def _driven_on(state: Reacting, own: Motion, dt: Float[Array, ""]) -> Reacting:
    """The progress along the path, and the speed, one step later under the pressure of others."""
    tightest = state.pressure
    accel = jnp.clip(ACCEL * (1.0 - tightest), -ACCEL_LIMIT, ACCEL)
    (logged,) = at_step(state.step, own.speed)
    following = (tightest == 0.0) & (state.speed >= logged - ACCEL * dt)
    speed = jnp.clip(state.speed + accel * dt, 0.0, logged)
    pace = jnp.where(
        logged > STILL_M_S,
        0.5 * (state.speed + speed) / jnp.maximum(logged, STILL_M_S),
        tightest == 0.0,  # where the log stands, time passes unless another agent is in the way
    )
    step = state.step + jnp.where(following, 1.0, jnp.clip(pace, 0.0, 1.0))
    (ahead,) = at_step(step, own.speed)
    return dataclasses.replace(state, step=step, speed=jnp.where(following, ahead, jnp.minimum(speed, ahead)))


def _pressed_by(
    disturbed: Bool[Array, " agent"],
    mine: Bodies,
    seen: Bodies,
    bend: Float[Array, " agent"],
    state: Reacting,
    own: Motion,
    turn: Float[Array, " agent"],
    world: World,
) -> tuple[Float[Array, " agent"], Float[Array, " agent"]]:
    """The interaction of each agent with the tightest disturbed agent that is or will be in its way; 0 if none is.

    The second value is the braking [m/s^2] that those in its way now make necessary. Few agents are disturbed at a
    time, so all agents are compared with one after the other, instead of all pairs. `mine` face along their paths.
    """
    way = None if world.logged_way is None else own_way(own, state, world.dt)

    def compare(now: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        left, tightest, hardest = now
        chosen = jnp.argmax(left)
        theirs = rows_of(seen, chosen)
        gap, closing = (pair[:, 0] for pair in gaps_ahead(along_arcs(mine, bend, _alone(theirs)), mine, _alone(theirs)))
        felt = pressure(state.speed, gap, closing)
        if way is not None and world.logged_way is not None:
            log, driven = rows_of((world.log, world.logged_way.driven), chosen)
            other = way_of_other(theirs, look_up(turn, chosen), log, driven)
            felt = jnp.maximum(felt, pressure_foreseen(way, other, mine, theirs))
        return (
            left & (seen.index != chosen),
            jnp.maximum(tightest, felt),
            jnp.maximum(hardest, braking_needed(jnp, gap, closing)),
        )

    none = mapped_with(disturbed, jnp.zeros_like(state.speed))
    _, tightest, hardest = jax.lax.while_loop(lambda now: now[0].any(), compare, (disturbed, none, none))
    return tightest, hardest


def _alone(body: Bodies) -> Bodies:
    """One body as a row of bodies."""
    return jax.tree.map(lambda value: value[None], body)
