"""A planner of the mirror at the wheel of a host simulator: one decision per step."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.mirror.bicycle import Motion, clip, step
from regents_cosim.mirror.rollout import others
from regents_cosim.mirror.world import World, to_world
from regents_cosim.planners.interface import JaxPlanner, Scene, find_planner
from regents_cosim.scenario import Scenario


class LoopDriver:
    """Drives the ego by the simulator's own states instead of the mirror's.

    Picklable until `start`. The ego moves by the mirror's bicycle; what it reacts to is what the
    simulator reports, step by step, so that nothing of the future can leak in.
    """

    def __init__(self, planner: str) -> None:
        self.planner = planner

    def start(self, scenario: Scenario) -> None:
        """Prepare for `scenario`. Raises PlannerError where the planner cannot be found."""
        self._loop = find_planner(self.planner)
        self._world = to_world(scenario)
        self._scene = Scene(scenario, self._world)
        self._memory = self._loop.init(self._scene)
        self._seen = jax.tree.map(np.array, self._world.log)
        self._valid = np.zeros(self._world.valid.shape, bool)

    def advance(
        self,
        step: int,
        x: Float[np.ndarray, " agent"],
        y: Float[np.ndarray, " agent"],
        yaw: Float[np.ndarray, " agent"],
        speed: Float[np.ndarray, " agent"],
        valid: Bool[np.ndarray, " agent"],
    ) -> tuple[float, float, float, float]:
        """The ego's (x, y, yaw, speed) at `step` + 1, from all agents as reported at `step` (map frame)."""
        now, (east, north) = len(x), self._scene.origin
        for known, value in zip(
            (self._seen.x, self._seen.y, self._seen.yaw, self._seen.speed),
            (x - east, y - north, yaw, speed),
            strict=True,
        ):
            known[:now, step] = value
        self._valid[:now, step] = valid
        seen, valid_so_far = jax.tree.map(jnp.asarray, (self._seen, self._valid))
        ego, self._memory = _decide(self._loop, self._memory, self._world, seen, valid_so_far, jnp.int32(step))
        ahead = [float(value) for value in (ego.x, ego.y, ego.yaw, ego.speed)]
        return ahead[0] + float(east), ahead[1] + float(north), ahead[2], ahead[3]


@eqx.filter_jit
def _decide(
    planner: JaxPlanner, memory: Any, world: World, seen: Motion, valid: Bool[Array, "agent time"], now: Int[Array, ""]
) -> tuple[Motion, Any]:
    """The ego's next state and the planner's next memory."""
    world = eqx.tree_at(lambda w: w.valid, world, valid)
    sight = planner.look(memory, others(world, seen))
    ego = jax.tree.map(lambda values: values[0, now], seen)
    control, memory = planner.step(memory, jax.tree.map(lambda values: values[now], sight), ego)
    return step(ego, clip(control), world.dt), memory
