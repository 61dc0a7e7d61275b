"""A planner of the mirror at the wheel of a host simulator: one decision per step."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.rollout import decide, move_ego, others
from regents_cosim.mirror.world import World, to_world
from regents_cosim.planners.interface import JaxPlanner, Scene, find_planner, start
from regents_cosim.scenario import Scenario


class LoopDriver:
    """Drives the ego by the simulator's own states instead of the mirror's.

    Picklable until `start`. The ego moves by the mirror's model; what it reacts to is what the
    simulator reports, step by step, so that nothing of the future can leak in.
    """

    def __init__(self, planner: str) -> None:
        self.planner = planner

    def start(self, scenario: Scenario) -> None:
        """Prepare for `scenario`. Raises PlannerError where the planner cannot be found."""
        self._loop = find_planner(self.planner)
        self._world = to_world(scenario)
        self._scene = Scene(scenario, self._world)
        self._memory = start(self._loop, self._scene, self.planner)

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
        east, north = self._scene.origin
        missing = self._world.valid.shape[0] - len(x)
        states = (np.pad(values, (0, missing)) for values in (x - east, y - north, yaw, speed))
        seen = Motion(*(jnp.asarray(values, jnp.float32)[:, None] for values in states))
        present = jnp.asarray(np.pad(valid, (0, missing)))[:, None]
        ego, self._memory = _move(self._loop, self._memory, self._world, seen, present)
        ahead = [float(value) for value in (ego.x, ego.y, ego.yaw, ego.speed)]
        return ahead[0] + float(east), ahead[1] + float(north), ahead[2], ahead[3]


@eqx.filter_jit
def _move(
    planner: JaxPlanner, memory: Any, world: World, seen: Motion, valid: Bool[Array, "agent 1"]
) -> tuple[Motion, Any]:
    """The ego's next state and the planner's next memory, from one instant of all agents."""
    ego = jax.tree.map(lambda values: values[0, 0], seen)
    control, memory = decide(planner, memory, others(world, seen, valid), ego)
    return move_ego(world, ego, control), memory
