"""When a driver acts on a danger that comes and goes: one rule for the verdict, for the search and for the planners.

A danger is believed once it has lasted as long as it takes to evaluate it; some time after that the brakes act. A
danger that has not been seen for a while by then is dismissed, and nothing is done about it: who brakes to a standstill
because of what was over before the foot was on the brake would get out of a later crash by luck. UN Regulation 157 says
nothing of this case, as its dangers last; the careful driver dismisses a danger by what it takes to believe one.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from regents_cosim.planners.reference.parameters import CAREFUL

_NEAREST = 0.499


def careful_perceives(xp: Any, risk: Any, dt: Any) -> Any:
    """The first step of a danger that the careful driver believes and does not dismiss; the number of steps if none.

    `risk` [time] tells when there is one. For NumPy and JAX alike.
    """
    steps = risk.shape[0]
    now = xp.arange(steps)
    seen = xp.concatenate([xp.zeros(1, int), xp.cumsum(risk)])  # dangers before each step

    def within(last: Any) -> Any:
        return seen[now + 1] - seen[xp.maximum(now + 1 - last, 0)]

    lasting = _steps(xp, CAREFUL.evaluation_s, dt)
    believed = within(lasting + 1) == lasting + 1
    dismissed = xp.cumsum(within(_steps(xp, CAREFUL.dismissal_s, dt)) == 0)
    acts = xp.minimum(now - lasting + careful_reaction_steps(xp, dt), steps - 1)
    kept = believed & (dismissed[acts] == dismissed)
    return xp.where(kept.any(), xp.argmax(kept) - lasting, steps)


def careful_reaction_steps(xp: Any, dt: Any) -> Any:
    """From the first step of a danger to the last one before the brakes act."""
    return _steps(xp, CAREFUL.evaluation_s + CAREFUL.delay_s, dt)


def _steps(xp: Any, seconds: float, dt: Any) -> Any:
    """The nearest number of steps; of two as near the lower one, in single precision too."""
    return xp.floor(seconds / dt + _NEAREST).astype(int)


class Reaction(eqx.Module):
    """For how many steps a driver has evaluated dangers, has been about to brake, and has not seen any."""

    danger: Int[Array, " agent"]  # steps for which each has been one without a break
    reacts: Int[Array, ""]  # steps since it has decided to brake; 0 before
    calm: Int[Array, ""]  # steps since the last danger
    braking: Float[Array, ""]  # [m/s^2] reached by now

    @classmethod
    def none(cls, agents: int) -> "Reaction":
        """Before anything has happened."""
        return cls(jnp.zeros(agents, int), jnp.int32(0), jnp.int32(0), jnp.float32(0.0))


class ReactionTimes(eqx.Module):
    """How fast a driver reacts."""

    evaluation_s: float  # for so long a danger has to last
    delay_s: float  # from then to the brakes
    dismissal_s: float  # for so long without one, it does not brake after all
    lets_go_s: float  # for so long without one, it brakes no longer
    jerk: float  # [m/s^3] with which the brakes are built up

    def next(self, before: Reaction, wanted: Float[Array, " agent"], dt: Float[Array, ""]) -> Reaction:
        """One step on, when the others call for so much braking [m/s^2]; where none does, it brakes on as it is."""
        lasting, dismissed, over = (_steps(jnp, s, dt) for s in (self.evaluation_s, self.dismissal_s, self.lets_go_s))
        delay = _steps(jnp, self.evaluation_s + self.delay_s, dt) - lasting
        some = (wanted > 0.0).any()
        danger = jnp.where(wanted > 0.0, before.danger + 1, 0)
        calm = jnp.where(some, 0, before.calm + 1)
        begun = (danger > lasting).any() | (before.reacts > 0)
        reacts = jnp.where(begun & (calm < jnp.where(before.reacts > delay, over, dismissed)), before.reacts + 1, 0)
        most = jnp.where(some, wanted.max(), before.braking)
        braking = jnp.where(reacts > delay, jnp.minimum(before.braking + self.jerk * dt, most), 0.0)
        return Reaction(danger, reacts, calm, braking)
