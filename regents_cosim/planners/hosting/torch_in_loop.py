"""A translated torch module inside the compiled loop, with the inputs and outputs of `torch_bridge`."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from regents_cosim.geometry.frames import ahead_and_left
from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.mirror.programs.jax_settings import in_float32
from regents_cosim.mirror.rollout import Traffic
from regents_cosim.planners.hosting.torch_bridge import NEAREST, TorchPlanner
from regents_cosim.planners.hosting.torch_translation import NotTranslatedError, Translated, translate
from regents_cosim.planners.jax_planner import CompiledScene, JaxPlanner
from regents_cosim.system.foreign_code import foreign_code, said_by


class TorchMemory(eqx.Module):
    """The constants of a scene."""

    target: Float[Array, " 2"]  # [m]
    size: Float[Array, " 2"]  # [m] length and width


@in_float32
def in_loop(planner: TorchPlanner) -> "TorchInLoop | None":
    """The planner inside the compiled loop; None where its module cannot be translated or does not fit.

    Raises PlannerError for something that is no module.
    """
    import torch

    chance = torch.Generator().manual_seed(0)
    examples = (10.0 * torch.randn(shape, generator=chance) for shape in ((1, 5), (1, NEAREST, 8)))
    try:
        with foreign_code(lambda error: NotTranslatedError(said_by(error))):
            module = translate(planner.module, *examples)
    except NotTranslatedError:  # its process will report what is wrong with a module that cannot be made
        return None
    answer = eqx.filter_eval_shape(module, jnp.zeros((1, 5)), jnp.zeros((1, NEAREST, 8)))
    # its process will report an answer of another shape as well
    return TorchInLoop(module) if answer.shape == (1, 2) else None


class TorchInLoop(JaxPlanner):
    """The planner of a translated module."""

    module: Translated

    def init(self, scene: CompiledScene) -> TorchMemory:
        """The target, and the ego's size."""
        sizes = (scene.world.half_length[0], scene.world.half_width[0])
        return TorchMemory(scene.on_device(np.array([scene.scenario.target]))[0], 2.0 * jnp.stack(sizes))

    def step(self, memory: TorchMemory, sight: Traffic, ego: Motion) -> tuple[ControlArrays, TorchMemory]:
        """Ask the module for controls."""
        east, north = memory.target
        goal = ahead_and_left(jnp, east - ego.x, north - ego.y, ego.yaw)
        at = jnp.stack([ego.speed, *memory.size, *goal])
        accel, curvature = self.module(at[None], _others(sight, ego)[None])[0]
        return ControlArrays(accel, curvature), memory


def _others(sight: Traffic, ego: Motion) -> Float[Array, "nearest 8"]:
    motion, turn = sight.motion, sight.motion.yaw - ego.yaw
    ahead, left = ahead_and_left(jnp, motion.x - ego.x, motion.y - ego.y, ego.yaw)
    sizes = (2.0 * sight.half_length, 2.0 * sight.half_width)
    table = jnp.stack([jnp.ones_like(turn), ahead, left, jnp.cos(turn), jnp.sin(turn), motion.speed, *sizes], axis=-1)
    table = jnp.where(sight.valid[:, None], table, 0.0)
    away = jnp.where(sight.valid, jnp.hypot(ahead, left), jnp.inf)
    count = min(NEAREST, len(away))
    _, order = jax.lax.top_k(-away, count)
    return jnp.pad(table[order], ((0, NEAREST - count), (0, 0)))
