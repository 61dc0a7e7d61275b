"""When a driver in the closed loop acts on dangers that come and go: the rule of `norms.reaction`, step by step."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from regents_cosim.norms.reaction import steps_of


class Reaction(eqx.Module):
    """The state of a driver's reaction: how long dangers have lasted, and how far it has reacted."""

    danger: Int[Array, " agent"]  # steps for which each agent has been a danger without a break
    reacts: Int[Array, ""]  # steps since it decided to brake; 0 before
    calm: Int[Array, ""]  # steps since the last danger
    braking: Float[Array, ""]  # [m/s^2] reached by now

    @classmethod
    def none(cls, agents: int) -> "Reaction":
        """The state before anything has happened."""
        return cls(jnp.zeros(agents, int), jnp.int32(0), jnp.int32(0), jnp.float32(0.0))


class ReactionTimes(eqx.Module):
    """The times of a driver's reaction."""

    evaluation_s: float  # a danger has to last this long
    delay_s: float  # from then to the brakes
    dismissal_s: float  # without a danger for this long it does not brake after all
    lets_go_s: float  # without a danger for this long it releases the brakes
    jerk: float  # [m/s^3] with which braking builds up

    def next(self, before: Reaction, wanted: Float[Array, " agent"], dt: Float[Array, ""]) -> Reaction:
        """The state one step later, given the braking [m/s^2] that the others call for; without any it brakes on."""
        lasting, dismissed, over = (steps_of(jnp, s, dt) for s in (self.evaluation_s, self.dismissal_s, self.lets_go_s))
        delay = steps_of(jnp, self.evaluation_s + self.delay_s, dt) - lasting
        some = (wanted > 0.0).any()
        danger = jnp.where(wanted > 0.0, before.danger + 1, 0)
        calm = jnp.where(some, 0, before.calm + 1)
        begun = (danger > lasting).any() | (before.reacts > 0)
        reacts = jnp.where(begun & (calm < jnp.where(before.reacts > delay, over, dismissed)), before.reacts + 1, 0)
        most = jnp.where(some, wanted.max(), before.braking)
        braking = jnp.where(reacts > delay, jnp.minimum(before.braking + self.jerk * dt, most), 0.0)
        return Reaction(danger, reacts, calm, braking)
