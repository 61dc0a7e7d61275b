"""A planner at the wheel of a host simulator: one decision per step, by the simulator's own states.

The ego moves by the mirror's model; what the planner reacts to is what the simulator reports,
step by step, so that nothing of the future can leak in.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.compiled import compiled
from regents_cosim.mirror.rollout import decide, move_ego, others
from regents_cosim.mirror.world import World, scene_origin, to_world
from regents_cosim.planners.closed_loop import move, scene_of
from regents_cosim.planners.host_process import HostProcess
from regents_cosim.planners.interface import Placement, Seen
from regents_cosim.planners.jax_planner import JaxPlanner, LoopScene, start
from regents_cosim.planners.systems import ACT_TIMEOUT_S, find_planner
from regents_cosim.scenario import Scenario


def driver_for(planner: str, act_timeout_s: float = ACT_TIMEOUT_S) -> "LoopDriver | HostDriver":
    """A driver for the planner of that name. Raises PlannerError where there is none."""
    if isinstance(find_planner(planner), JaxPlanner):
        return LoopDriver(planner)
    return HostDriver(planner, act_timeout_s)


class LoopDriver:
    """A planner of the mirror's compiled loop. Picklable until `start`, like the other."""

    def __init__(self, planner: str) -> None:
        self.planner = planner

    def start(self, scenario: Scenario) -> None:
        """Prepare for `scenario`. Raises PlannerError where the planner fails."""
        loop = find_planner(self.planner)
        assert isinstance(loop, JaxPlanner)
        self._loop = loop
        self._world = to_world(scenario)
        self._scene = LoopScene(scenario, self._world)
        self._memory = start(self._loop, self._scene, self.planner)

    def advance(self, step: int, seen: Seen) -> tuple[float, float, float, float]:
        """The ego's (x, y, yaw, speed) at `step` + 1, from all agents as reported at `step` (map frame)."""
        east, north = self._scene.origin
        missing = self._world.valid.shape[0] - len(seen.x)
        states = (np.pad(values, (0, missing)) for values in (seen.x - east, seen.y - north, seen.yaw, seen.speed))
        motion = Motion(*(jnp.asarray(values, jnp.float32)[:, None] for values in states))
        present = jnp.asarray(np.pad(seen.valid, (0, missing)))[:, None]
        ego, self._memory = _move(self._loop, self._memory, self._world, motion, present)
        ahead = [float(value) for value in (ego.x, ego.y, ego.yaw, ego.speed)]
        return ahead[0] + float(east), ahead[1] + float(north), ahead[2], ahead[3]


class HostDriver:
    """A planner in a process of its own."""

    def __init__(self, planner: str, act_timeout_s: float) -> None:
        self.planner, self.act_timeout_s = planner, act_timeout_s

    def start(self, scenario: Scenario) -> None:
        """Prepare for `scenario`. Raises DriveError where the planner fails."""
        self._world, self._origin = to_world(scenario), np.array([*scene_origin(scenario), 0.0, 0.0])
        self._process = HostProcess(self.planner, self.act_timeout_s)
        self._process.reset([scene_of(scenario)])

    def advance(self, step: int, seen: Seen) -> tuple[float, float, float, float]:
        """The ego's (x, y, yaw, speed) at `step` + 1, from all agents as reported at `step` (map frame)."""
        (answer,) = self._process.act(step, [seen])
        decision = answer.decision
        if isinstance(decision, Placement):
            return decision.x, decision.y, decision.yaw, decision.speed
        ego = np.array([values[0] for values in seen[:4]]) - self._origin
        ahead = move(self._world, ego, (decision.accel, decision.curvature)) + self._origin
        return float(ahead[0]), float(ahead[1]), float(ahead[2]), float(ahead[3])


@compiled
def _move(
    planner: JaxPlanner, memory: Any, world: World, seen: Motion, valid: Bool[Array, "agent 1"]
) -> tuple[Motion, Any]:
    """The ego's next state and the planner's next memory, from one instant of all agents."""
    ego = jax.tree.map(lambda values: values[0, 0], seen)
    control, memory = decide(planner, memory, others(world, seen, valid), ego)
    return move_ego(world, ego, control), memory
