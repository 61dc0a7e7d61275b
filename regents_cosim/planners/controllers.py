"""A planner that drives in a simulator: one decision per step, from the states that the simulator reports.

The ego moves by the mirror's model, and the planner sees only the reported states, step by step, so nothing of the
future can leak in.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.programs.jax_settings import in_float32
from regents_cosim.mirror.rollout import decide, move_ego, others
from regents_cosim.mirror.world import World, scene_origin, to_roadless_world
from regents_cosim.planners.closed_loop import move, scene_of
from regents_cosim.planners.hosting.host_pool import HostPool
from regents_cosim.planners.hosting.host_process import HostProcess
from regents_cosim.planners.interface import Control, Debug, Placement, Snapshot
from regents_cosim.planners.jax_planner import CompiledScene, JaxPlanner, foreign, require_finite, start
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S
from regents_cosim.planners.under_test import AnyPlanner, PlannerUnderTest
from regents_cosim.scenario.scenario import Scenario


class PlannerControllers:
    """A context manager that lends controllers of one planner, and ends their processes."""

    def __init__(self, planner: AnyPlanner, act_timeout_s: float = ACT_TIMEOUT_S) -> None:
        """Raises PlannerError where there is no such planner, RegentsError for an impossible time limit."""
        self._planner = PlannerUnderTest.of(planner)
        self._hosts = HostPool(self._planner, act_timeout_s)

    @property
    def name(self) -> str:
        """The planner's name."""
        return self._planner.name

    def __enter__(self) -> "PlannerControllers":
        return self

    def __exit__(self, *error: object) -> None:
        self._hosts.__exit__(*error)

    @contextmanager
    def lend(self) -> "Iterator[LoopController | HostController]":
        """Lend a controller for one drive."""
        if self._planner.loop is not None:
            yield LoopController(self._planner.name, self._planner.loop)
            return
        with self._hosts.lend() as process:
            yield HostController(process)


class LoopController:
    """The controller of a planner that runs in the mirror's compiled loop."""

    def __init__(self, name: str, planner: JaxPlanner) -> None:
        self._name, self._loop = name, planner

    @in_float32
    def start(self, scenario: Scenario, world: World | None = None) -> None:
        """Prepare for `scenario`, whose `world` may be known. Raises DriveError where the planner fails."""
        self._world = to_roadless_world(scenario) if world is None else world
        self._scene = CompiledScene(scenario, self._world)
        self._memory = start(self._loop, self._scene, self._name)

    @in_float32
    def advance(self, step: int, seen: Snapshot) -> tuple[float, float, float, float]:
        """The ego's (x, y, yaw, speed) at `step` + 1, from all agents as reported at `step` (map frame).

        Raises DriveError where the planner fails.
        """
        east, north = self._scene.origin
        missing = self._world.valid.shape[0] - len(seen.x)
        states = (np.pad(values, (0, missing)) for values in (seen.x - east, seen.y - north, seen.yaw, seen.speed))
        motion = Motion(*(jnp.asarray(values[:, None].astype(np.float32)) for values in states))
        present = jnp.asarray(np.pad(seen.valid, (0, missing))[:, None])
        with foreign(self._name, self._scene.scenario.id, f"at step {step}"):
            moved = _move(self._loop, self._memory, self._world, motion, present)
            ego, control, self._memory = jax.block_until_ready(moved)
        require_finite(control, self._name, self._scene.scenario.id, step)
        ahead = [float(value) for value in (ego.x, ego.y, ego.yaw, ego.speed)]
        return ahead[0] + float(east), ahead[1] + float(north), ahead[2], ahead[3]

    def thoughts(self) -> dict[int, Debug]:
        """Nothing: a planner in the loop tells no thoughts."""
        return {}


class HostController:
    """The controller of a planner outside JAX."""

    def __init__(self, process: HostProcess) -> None:
        self._process = process
        self._thoughts = dict[int, Debug]()

    @in_float32
    def start(self, scenario: Scenario, world: World | None = None) -> None:
        """Prepare for `scenario`, whose `world` may be known. Raises DriveError where the planner fails."""
        self._world = to_roadless_world(scenario) if world is None else world
        self._origin = np.array([*scene_origin(scenario), 0.0, 0.0])
        self._process.reset([scene_of(scenario)])
        self._thoughts.clear()

    @in_float32
    def advance(self, step: int, seen: Snapshot) -> tuple[float, float, float, float]:
        """The ego's (x, y, yaw, speed) at `step` + 1, from all agents as reported at `step` (map frame).

        Raises DriveError where the planner fails.
        """
        (answer,) = self._process.act(step, [seen], debug=True)
        decision = answer.decision
        if isinstance(decision, Control) and decision.debug is not None:
            self._thoughts[step] = decision.debug
        if isinstance(decision, Placement):
            return decision.x, decision.y, decision.yaw, decision.speed
        ego = np.array([values[0] for values in seen[:4]]) - self._origin
        ahead = move(self._world, ego, (decision.accel, decision.curvature)) + self._origin
        return float(ahead[0]), float(ahead[1]), float(ahead[2]), float(ahead[3])

    def thoughts(self) -> dict[int, Debug]:
        """What the planner has thought in this drive, by step."""
        return dict(self._thoughts)


@compiled
def _move(
    planner: JaxPlanner, memory: Any, world: World, seen: Motion, valid: Bool[Array, "agent 1"]
) -> tuple[Motion, ControlArrays, Any]:
    """The ego's next state, the planner's control and its next memory, from one instant of all agents."""
    ego = jax.tree.map(lambda values: values[0, 0], seen)
    control, memory = decide(planner, memory, others(world, seen, valid), ego)
    return move_ego(world, ego, control), control, memory
