"""Policies in files: a `.zip` of stable-baselines3 or sb3-contrib, or a `.cleanrl_model` of CleanRL.

Neither tells what it was trained with, so a file of the same name with `.json` lies beside it: the configuration of the
environment, as in `gymnasium.make(..., config=...)`.
"""

import json
import re
import zipfile
from importlib import import_module
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from regents_cosim.errors import MissingDependencyError, PlannerError

# What activates the layers of a network, by its name in CleanRL's dqn, ppo and ppo_continuous_action.
_CLEANRL = {"network": lambda values: np.maximum(values, 0.0), "actor": np.tanh, "actor_mean": np.tanh}

# The module of a policy, e.g. stable_baselines3.dqn.policies: its package, and its folder, which tells the method.
_POLICY_MODULE = re.compile(r"(stable_baselines3|sb3_contrib)\.(?:\w+\.)*(\w+)\.policies")
_METHODS = {"maskable": "MaskablePPO", "recurrent": "RecurrentPPO", "crossq": "CrossQ"}  # of folders; others are as DQN

# What stable-baselines3 needs in training only. A schedule is saved as bytecode, at which another Python may die, and a
# buffer takes memory.
_OF_TRAINING: dict[str, Any] = {
    "learning_rate": 0.0, "lr_schedule": None, "exploration_schedule": None, "clip_range": 0.2, "clip_range_vf": None,
    "buffer_size": 1, "replay_buffer_class": None, "replay_buffer_kwargs": {}, "rollout_buffer_class": None,
}  # fmt: skip


class FilePolicy:
    """A policy with the configuration that lies beside it."""

    def __init__(self, path: Path) -> None:
        """Raises PlannerError where a file is missing or of another kind."""
        self.config = _config(path)
        model = _POLICIES[path.suffix](path)
        self.predict = model.predict
        self.observation_space, self.action_space = (
            getattr(model, f"{name}_space", None) for name in ("observation", "action")
        )


def is_policy_file(name: str) -> bool:
    """Whether an agent's name is that of a policy's file."""
    return Path(name).suffix in _POLICIES


def _config(path: Path) -> dict[str, Any]:
    beside = path.with_suffix(".json")
    if not path.is_file():
        raise PlannerError(f"policy {path}: there is no such file")
    if not beside.is_file():
        raise PlannerError(
            f"policy {path}: {beside.name} is not beside it, expected the configuration of the environment of its "
            "training, as json.dump(env.unwrapped.config, file) writes it"
        )
    try:
        return _with_tuples(msgspec.json.decode(beside.read_bytes(), type=dict[str, Any]))
    except msgspec.MsgspecError as error:
        raise PlannerError(f"{beside}: {error}, expected a configuration of highway-env as JSON") from error


def _with_tuples(value: Any) -> Any:
    """Settings with tuples for lists of numbers, as highway-env takes no list as the shape of a picture."""
    if isinstance(value, dict):
        return {name: _with_tuples(one) for name, one in value.items()}
    if isinstance(value, list) and value and all(isinstance(one, int | float) for one in value):
        return tuple(value)
    return value


def _of_stable_baselines(path: Path) -> Any:
    try:
        with zipfile.ZipFile(path) as archive:
            data = json.loads(archive.read("data"))
        module = data["policy_class"]["__module__"]
    except (zipfile.BadZipFile, KeyError, ValueError, TypeError) as error:
        raise PlannerError(f"policy {path} is no model that stable-baselines3 has saved") from error
    if not (named := _POLICY_MODULE.fullmatch(str(module))):
        raise PlannerError(
            f"policy {path}: its class is of {module}, not of stable-baselines3: expected highway:FILE.py:POLICY, with "
            "code of yours that loads it"
        )
    package, folder = named.groups()
    try:
        made_by = import_module(package)
    except ImportError as error:
        raise MissingDependencyError(
            f"policy {path} needs {package}: pip install {package.replace('_', '-')}"
        ) from error
    if folder == "common":  # one policy for both; they ask it in the same way
        folder = "ppo" if "clip_range" in data else "a2c"
    method = getattr(made_by, _METHODS.get(folder, folder.upper()))
    return method.load(path, device="cpu", custom_objects=_OF_TRAINING)


class _CleanRl:
    def __init__(self, path: Path) -> None:
        try:
            import torch
        except ImportError as error:
            raise MissingDependencyError(f"policy {path} needs torch: pip install torch") from error
        wanted = PlannerError(f"policy {path}: expected the weights of CleanRL's dqn, ppo or ppo_continuous_action")
        try:
            weights = dict(torch.load(path, map_location="cpu", weights_only=True))
        except Exception as error:  # torch's own words advise to run what the file holds
            raise wanted from error
        part = next((part for part in _CLEANRL if f"{part}.0.weight" in weights), "")
        layers = sorted({int(name.split(".")[1]) for name in weights if name.startswith(f"{part}.")}) if part else []
        shapes = [weights[f"{part}.{layer}.weight"].shape for layer in layers]
        if not layers or any(len(shape) != 2 for shape in shapes):
            raise wanted
        self._layers = [
            (weights[f"{part}.{layer}.weight"].numpy(), weights[f"{part}.{layer}.bias"].numpy()) for layer in layers
        ]
        self._part, self._path = part, path

    def predict(self, observation: Any) -> Any:
        values = np.asarray(observation, np.float32).ravel()
        *hidden, (weight, bias) = self._layers
        takes = self._layers[0][0].shape[1]
        if len(values) != takes:
            raise ValueError(
                f"policy {self._path}: its network takes {takes} numbers, an observation has {len(values)} here: "
                f"expected the `observation` of its training in {self._path.with_suffix('.json').name}"
            )
        for inner, offset in hidden:
            values = _CLEANRL[self._part](inner @ values + offset)
        values = weight @ values + bias
        return values if self._part == "actor_mean" else int(np.argmax(values))


_POLICIES: dict[str, Any] = {".zip": _of_stable_baselines, ".cleanrl_model": _CleanRl}
