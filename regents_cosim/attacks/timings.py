"""Other timings of a candidate on its own path, to begin a descent where the log leads nowhere.

A descent that starts from the log is stuck when the two vehicles would have to meet at another time: the gradient
pulls across, where a median or other traffic forbids it. Driving the same path faster or slower is free of
that: of a few such drives the one that the cost likes best is where the next descent begins.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from regents_cosim.attacks.costs import total_cost
from regents_cosim.attacks.descent import to_actions
from regents_cosim.attacks.movers import Movers
from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.mirror.bicycle import Controls, Motion, clip
from regents_cosim.mirror.compiled import compiled
from regents_cosim.mirror.dynamics import roll_out
from regents_cosim.mirror.rollout import roll_out_background, with_ego
from regents_cosim.mirror.world import World

# [m/s^2] and [m/s]: how quickly a drive departs from the logged speed, and by how much at most.
_CHANGES = np.array(
    [(sign * accel, most) for sign in (-1.0, 1.0) for accel, most in ((1.0, 4.0), (2.5, 2.0), (2.5, 5.0), (2.5, 10.0))]
    + [(-4.0, 40.0), (1.0, 2.0), (-1.0, 2.0), (4.0, 6.0)],
    np.float32,
)


@compiled
def retimed(world: World, ego: Motion, movers: Movers, config: AttackConfig, rank: Int[Array, ""]) -> Controls:
    """The actions [1, step] of the timing with the `rank`-th lowest cost while the ego stays on its track [time].

    `movers` is a single agent.
    """
    start, moving, half_length = movers.rows((world.start, world.moving, world.half_length))
    background = with_ego(roll_out_background(world, world.controls), ego)

    def drive(change: Float[Array, " 2"]) -> tuple[Controls, Float[Array, ""]]:
        controls = _at_other_speed(world, movers, change)
        motion = movers.put(background, roll_out(world.dynamics, start, controls, moving, half_length, world.dt))
        return controls, total_cost(world, world.boxes(motion), movers, config).total

    drives, costs = jax.vmap(drive)(jnp.asarray(_CHANGES))
    chosen = jnp.argsort(costs)[rank]
    return to_actions(jax.tree.map(lambda values: values[chosen], drives))


def _at_other_speed(world: World, movers: Movers, change: Float[Array, " 2"]) -> Controls:
    """Controls [1, step] that keep to the logged path, whose curvature belongs to places and not to times."""
    speed, moving, logged = movers.rows((world.log.speed, world.moving, world.controls))
    since = jnp.cumsum(jnp.pad(moving, ((0, 0), (1, 0))), axis=1) * world.dt
    faster = jnp.maximum(speed + jnp.clip(change[0] * since, -change[1], change[1]), 0.0)
    accel = jnp.diff(faster, axis=1) / world.dt
    curvature = jnp.interp(_middles(faster, world.dt), _middles(speed, world.dt), logged.curvature[0], right=0.0)
    return clip(Controls(accel, curvature[None]))


def _middles(speed: Float[Array, "1 time"], dt: Float[Array, ""]) -> Float[Array, " step"]:
    """How far along its way a vehicle is in the middle of each step [m]."""
    lengths = 0.5 * (speed[0, 1:] + speed[0, :-1]) * dt
    return jnp.cumsum(lengths) - 0.5 * lengths
