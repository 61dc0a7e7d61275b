"""Planners that are blind to all others: one goes straight on, one replays the recorded ego."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Int

from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.planners.jax_planner import CompiledScene, JaxPlanner


class ConstantVelocity(JaxPlanner):
    """A planner that neither accelerates nor steers."""

    def step(self, memory: Any, sight: Any, ego: Motion) -> tuple[ControlArrays, Any]:
        """Zero controls."""
        return ControlArrays(jnp.zeros_like(ego.x), jnp.zeros_like(ego.x)), memory


class LogReplay(JaxPlanner):
    """The open-loop ego of published tables: it applies the fitted controls of its own track, one after the other."""

    def init(self, scene: CompiledScene) -> tuple[Int[Array, ""], ControlArrays]:
        """The next step, and all controls."""
        logged = scene.world.controls
        return jnp.int32(0), ControlArrays(logged.accel[0], logged.curvature[0])

    def step(self, memory: Any, sight: Any, ego: Motion) -> tuple[ControlArrays, Any]:
        """The logged control of this step."""
        now, logged = memory
        return ControlArrays(logged.accel[now], logged.curvature[now]), (now + 1, logged)
