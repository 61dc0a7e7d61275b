"""The simplest planner: goes straight on at the speed it has."""

from typing import Any

import jax.numpy as jnp

from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.planners.jax_planner import JaxPlanner


class ConstantVelocity(JaxPlanner):
    """No acceleration, no steering, whatever happens."""

    def step(self, memory: Any, sight: Any, ego: Motion) -> tuple[ControlArrays, Any]:
        """Zero controls."""
        return ControlArrays(jnp.zeros_like(ego.x), jnp.zeros_like(ego.x)), memory
