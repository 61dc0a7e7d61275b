"""Planners in JAX that fail in one case, each in its way."""

import jax
import jax.numpy as jnp
import numpy as np

from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.planners.jax_planner import JaxPlanner

AT_STEP = 7
ANSWERS = {"nan": jnp.nan, "plus": jnp.inf, "minus": -jnp.inf}


class FailsInOneCase(JaxPlanner):
    """Answers what the id of the case says from step 7 on; goes straight on in all others."""

    def init(self, scene):
        return jnp.int32(0), jnp.float32(ANSWERS.get(scene.scenario.id, 0.0))

    def step(self, memory, sight, ego):
        asked, answer = memory
        accel = jnp.where(asked < AT_STEP, 0.0, answer)
        return ControlArrays(accel=accel, curvature=jnp.float32(0.0)), (asked + 1, answer)


class RaisesInOneCase(JaxPlanner):
    """Raises in a callback, in the case `bad`."""

    def init(self, scene):
        return jnp.asarray(scene.scenario.id == "bad")

    def step(self, memory, sight, ego):
        accel = jax.pure_callback(_call, jax.ShapeDtypeStruct((), jnp.float32), memory, vmap_method="sequential")
        return ControlArrays(accel=accel, curvature=jnp.float32(0.0)), memory


def _call(bad):
    if bad:
        raise KeyError("lost")
    return np.float32(0.0)
