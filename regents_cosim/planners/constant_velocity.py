"""The simplest planner, which goes straight on at its present speed."""

from typing import Any

import jax.numpy as jnp

from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.planners.jax_planner import JaxPlanner


class ConstantVelocity(JaxPlanner):
    """A planner that neither accelerates nor steers."""

    def step(self, memory: Any, sight: Any, ego: Motion) -> tuple[ControlArrays, Any]:
        """Zero controls."""
        return ControlArrays(jnp.zeros_like(ego.x), jnp.zeros_like(ego.x)), memory
