"""`observed`: an ego whose driver we do not have. It keeps to its route at its recent speed and brakes for leaders."""

import equinox as eqx
import jax.numpy as jnp

from regents_cosim.planners.idm import IDM, IdmMemory
from regents_cosim.planners.jax_planner import LoopScene

OBSERVED = "observed"
_LEAST_M_S = 2.0  # one that stands is about to go on


class Observed(IDM):
    """IDM that wants to go no faster than the ego is predicted to, which is its recent speed."""

    def init(self, scene: LoopScene) -> IdmMemory:
        """The route of the ego, at its recent speed."""
        memory = super().init(scene)
        recent = max(float(scene.scenario.tracks.speed[0].max()), _LEAST_M_S)
        return eqx.tree_at(lambda m: m.speed, memory, jnp.minimum(memory.speed, recent))
