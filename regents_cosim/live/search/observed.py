"""The planner `observed`: an unknown driver keeps to its route at its recent speed, and brakes for leaders."""

import equinox as eqx
import jax.numpy as jnp

from regents_cosim.planners.idm import IDM, IdmMemory
from regents_cosim.planners.jax_planner import CompiledScene

OBSERVED = "observed"
_LEAST_M_S = 2.0  # a standing ego is assumed to start


class Observed(IDM):
    """IDM with the ego's recent speed as wanted speed, which is also the predicted one."""

    def init(self, scene: CompiledScene) -> IdmMemory:
        """The memory with the ego's route and its recent speed."""
        memory = super().init(scene)
        recent = max(float(scene.scenario.tracks.speed[0].max()), _LEAST_M_S)
        return eqx.tree_at(lambda m: m.speed, memory, jnp.minimum(memory.speed, recent))
