"""How hard an agent brakes for others, by the Intelligent Driver Model.

Of its acceleration only the interaction term is used, and only within the desired gap s* (`norms.following`), so that
undisturbed traffic stays exactly as recorded: a (1 - (s* / s)^2) where s < s*.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from regents_cosim.mirror.reactions.bodies import Along, Bodies
from regents_cosim.norms.following import LEAST_GAP_M, desired_gap

ACCEL = 2.0  # [m/s^2]
BRAKE = 4.0  # [m/s^2] comfortable
_HEADWAY_S = 0.5
_STANDSTILL_M = 1.0
SIDE_MARGIN_M = 0.2
FAR_M = 1e3
STILL_M_S = 0.05


def pressure(
    speed: Float[Array, "*#axes"], gap: Float[Array, "*axes"], closing: Float[Array, "*axes"]
) -> Float[Array, "*axes"]:
    """The interaction (s* / s)^2 with an agent at a `gap` [m]; 0 beyond s*. Speeds are in m/s."""
    wanted = desired_gap(jnp, speed, closing, _HEADWAY_S, _STANDSTILL_M, ACCEL, BRAKE)
    return jnp.where(gap < wanted, (wanted / jnp.maximum(gap, LEAST_GAP_M)) ** 2, 0.0)


def in_way(along: Along, mine: Bodies) -> Bool[Array, "agent other"]:
    """Which others lie on the way of an agent, ahead or behind."""
    return ~along.apart & (jnp.abs(along.left) - along.breadth < mine.half_width[:, None] + SIDE_MARGIN_M)


def gaps_ahead(
    along: Along, mine: Bodies, theirs: Bodies
) -> tuple[Float[Array, "agent other"], Float[Array, "agent other"]]:
    """The gap [m] to each agent ahead on the way, far where it is not, and the closing speed [m/s]."""
    ahead = in_way(along, mine) & (along.ahead > 0.0)
    gap = jnp.where(ahead, along.ahead - along.reach - mine.half_length[:, None], FAR_M)
    return gap, mine.speed[:, None] - theirs.speed[None] * along.same
