"""A torch module as a planner, named `torch:package.module:attribute` or `torch:file.py:attribute`.

The attribute is an `nn.Module`, or a class or function that makes one without arguments. For many scenes at once, and
without memory from step to step, it answers

    forward(ego [batch, 5], others [batch, 16, 8]) -> [batch, 2]

in float32, in the ego's frame (x ahead, y to the left, from box centre to box centre):

- ego: speed [m/s], length [m], width [m], the target ahead [m], the target to the left [m];
- others: the nearest 16, the nearest first, rows of zeros where there are fewer: 1 for one that is present, ahead [m],
to the left [m], cosine and sine of its yaw less the ego's, speed [m/s], length [m], width [m];
- answer: acceleration [m/s^2], curvature [1/m] positive to the left, cut off at 7.6 m/s^2 and 0.3 1/m.

It runs inside the compiled loop where it can be translated (`torch_translation`), otherwise in its own process, many
scenes at a time.

A module that needs lanes, lights or memory has to be wrapped with `reset` and `act` (`interface`).
"""

import importlib.util
import sys
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from regents_cosim.errors import MissingDependencyError, PlannerError, install_hint
from regents_cosim.geometry.boxes import same_level
from regents_cosim.geometry.frames import ahead_and_left
from regents_cosim.planners.find import find_attribute
from regents_cosim.planners.interface import Control, Observation, Scene

if TYPE_CHECKING:  # torch is an extra and slow to import, so it is imported where it is used
    from torch import nn

NEAREST = 16  # number of other agents that a module sees


class TorchPlanner:
    """The host planner around a torch module."""

    def __init__(self, name: str, found: Any = None) -> None:
        """The module is made when it is needed, from `found` or by its name.

        Raises PlannerError where there is nothing of that name, MissingDependencyError without torch.
        """
        if importlib.util.find_spec("torch") is None:
            raise MissingDependencyError(f"planner 'torch:{name}' needs the extra: {install_hint('torch')}")
        self._name = name
        self._found = find_attribute(name) if found is None else found

    def reset(self, scene: Scene) -> None:
        """Make the module if needed."""
        self.reset_batch([scene])

    def act(self, observation: Observation) -> Control:
        """The module's control for one scene."""
        return self.act_batch([observation])[0]

    def reset_batch(self, scenes: Sequence[Scene]) -> None:
        """Make the module if needed; it keeps nothing of a scene."""
        import torch

        torch.set_num_threads(1)  # one process per core already runs, and networks of planners are small
        _ = self.module

    def act_batch(self, observations: Sequence[Observation]) -> list[Control]:
        """The module's controls within the limits. Raises ValueError where they are not [batch, 2]."""
        import torch

        with torch.inference_mode():
            answer = self.module(*(torch.from_numpy(values) for values in features(observations)))
        shape = list(answer.shape) if isinstance(answer, torch.Tensor) else type(answer).__name__
        if shape != [len(observations), 2]:
            raise ValueError(
                f"the module answered {shape}, expected a tensor [{len(observations)}, 2] (batch, control)"
            )
        limits = np.array([[o.scene.max_accel, o.scene.max_curvature] for o in observations])
        return [Control(*pair) for pair in np.clip(answer.double().numpy(), -limits, limits).tolist()]

    @cached_property
    def module(self) -> "nn.Module":
        """The module in evaluation mode. Raises PlannerError where it is no module, and whatever making it raises."""
        import torch

        found: Any = self._found
        made = found if isinstance(found, torch.nn.Module) else found() if callable(found) else found
        if not isinstance(made, torch.nn.Module):
            raise PlannerError(f"planner 'torch:{self._name}' is a {type(made).__name__}, expected a torch.nn.Module")
        return made.eval()


def is_torch(planner: Any) -> bool:
    """Whether an object is a torch module, or a class of them."""
    torch = sys.modules.get("torch")  # a caller with a module has imported torch
    if torch is None:
        return False
    return isinstance(planner, torch.nn.Module) or (isinstance(planner, type) and issubclass(planner, torch.nn.Module))


def features(
    observations: Sequence[Observation],
) -> tuple[Float[np.ndarray, "batch 5"], Float[np.ndarray, "batch nearest 8"]]:
    """The inputs of a module, (ego, others), as in the docstring of this file."""
    at = np.array([[o.ego.x, o.ego.y, o.ego.yaw, o.ego.speed, o.ego.length, o.ego.width] for o in observations])
    goal = np.array([o.target for o in observations])
    x, y, yaw = at[:, 0], at[:, 1], at[:, 2]
    rows = max(NEAREST, *(len(o.others.agents) for o in observations), 0)
    seen, there = np.zeros((len(observations), rows, 6)), np.zeros((len(observations), rows), bool)
    for row, others in enumerate(o.others for o in observations):
        count = len(others.agents)
        values = (others.x, others.y, others.yaw, others.speed, others.length, others.width)
        on_level = others.valid & same_level(others.z, observations[row].ego.z)
        seen[row, :count], there[row, :count] = np.stack(values, axis=-1), on_level
    ahead, left = ahead_and_left(np, seen[..., 0] - x[:, None], seen[..., 1] - y[:, None], yaw[:, None])
    turn = seen[..., 2] - yaw[:, None]
    table = np.stack(
        [np.ones_like(turn), ahead, left, np.cos(turn), np.sin(turn), *np.moveaxis(seen[..., 3:], -1, 0)], -1
    )
    order = np.argsort(np.where(there, np.hypot(ahead, left), np.inf), axis=1, kind="stable")[:, :NEAREST, None]
    others = np.take_along_axis(np.where(there[..., None], table, 0.0), order, axis=1)
    ego = np.stack([*at[:, 3:].T, *ahead_and_left(np, goal[:, 0] - x, goal[:, 1] - y, yaw)], axis=-1)
    return ego.astype(np.float32), others.astype(np.float32)
