"""Agents that drive the ego in highway-env: its IDM and MDP models, random actions, or a user's policy.

Apart from this module only the source, the replay and the environments depend on highway-env.
"""

import inspect
import re
import reprlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete
from highway_env.envs.common.abstract import AbstractEnv
from highway_env.envs.common.action import action_factory
from highway_env.envs.common.finite_mdp import compute_ttc_grid
from highway_env.envs.common.observation import observation_factory
from highway_env.envs.intersection_env import IntersectionEnv
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.controller import ControlledVehicle

from regents_cosim.checks.names import did_you_mean
from regents_cosim.errors import PlannerError
from regents_cosim.simulators.highway.foresight import foreseen
from regents_cosim.simulators.highway.policy_files import FilePolicy, is_policy_file
from regents_cosim.system.foreign_code import foreign_code, said_by
from regents_cosim.system.user_code import import_named


@runtime_checkable
class HighwayAgent(Protocol):
    """Drives the controlled vehicle of a highway-env environment."""

    config: dict[str, Any]  # action and observation types that the agent needs

    def start(self, env: AbstractEnv, seed: int) -> None:
        """Take over after a reset."""
        ...

    def act(self, observation: Any) -> Any:
        """An action of the environment's action space."""
        ...


# For agents that read the road directly: computing observations would take most of the time, and some types of them
# fail on an IDM vehicle.
_NOTHING: dict[str, Any] = {"type": "AttributesObservation", "attributes": []}


# IDM's initial parameters. highway-env's intersections change them for all vehicles of the process, including those of
# later environments.
IDM_PARAMETERS = {
    "DISTANCE_WANTED": 5.0 + ControlledVehicle.LENGTH,  # [m]
    "COMFORT_ACC_MAX": 3.0,  # [m/s^2]
    "COMFORT_ACC_MIN": -5.0,  # [m/s^2]
}


class IDMAgent:
    """highway-env's own driver model, IDM with MOBIL lane changes, in place of the controlled vehicle."""

    def __init__(self) -> None:
        self.config: dict[str, Any] = {"observation": _NOTHING}

    def start(self, env: Any, seed: int) -> None:
        """Replace the controlled vehicle by an IDM vehicle."""
        old, road = env.vehicle, env.road
        # Without a target speed an IDM vehicle would keep its speed, so it gets the speed limit of the lane.
        wish = getattr(old, "target_speed", None) or getattr(old.lane, "speed_limit", None) or old.MAX_SPEED
        lane: Any = getattr(old, "target_lane_index", None)
        route: Any = getattr(old, "route", None)
        new = IDMVehicle(road, old.position, old.heading, old.speed, lane, wish, route)
        # the reward of two-way needs the last two
        for name in ("LENGTH", "WIDTH", "diagonal", "target_speeds", "speed_index"):
            if hasattr(old, name):
                setattr(new, name, getattr(old, name))
        if not isinstance(env.unwrapped, IntersectionEnv):
            vars(new).update(IDM_PARAMETERS)
        road.vehicles[road.vehicles.index(old)] = new
        env.controlled_vehicles[env.controlled_vehicles.index(old)] = new
        env.observation_type.observer_vehicle = new
        self._idle = _idle_action(env)

    def act(self, observation: Any) -> Any:
        """Return no action, since the vehicle decides itself."""
        return self._idle


class MDPAgent:
    """Meta-actions from highway-env's time-to-collision grid, by backward induction over 10 s.

    The state is (speed, lane, time). Collisions cost 1; speed and the right lane are worth what highway-env's default
    rewards give for them.
    """

    def __init__(self) -> None:
        self.config: dict[str, Any] = {"action": {"type": "DiscreteMetaAction"}, "observation": _NOTHING}

    def start(self, env: Any, seed: int) -> None:
        """Remember the environment, whose grid is read at every step."""
        if not hasattr(env.vehicle, "speed_index"):
            raise PlannerError("agent mdp needs an environment with the action type DiscreteMetaAction")
        self._env = env

    def act(self, observation: Any) -> Any:
        """The best of the meta-actions that are available."""
        env = self._env
        grid = compute_ttc_grid(env, time_quantization=1.0, horizon=10.0)
        best = _best_values(grid)
        now = env.vehicle.speed_index, env.vehicle.lane_index[2]
        values = {name: best[_after(name, *now, grid.shape)] for name in _MOVES}
        return max(env.get_available_actions(), key=lambda index: values[env.action_type.actions[index]])


_MOVES = {"IDLE": (0, 0), "LANE_LEFT": (0, -1), "LANE_RIGHT": (0, 1), "FASTER": (1, 0), "SLOWER": (-1, 0)}


def _after(move: str, speed: int, lane: int, shape: tuple[int, ...]) -> tuple[int, int]:
    faster, right = _MOVES[move]
    return int(np.clip(speed + faster, 0, shape[0] - 1)), int(np.clip(lane + right, 0, shape[1] - 1))


def _best_values(grid: np.ndarray) -> np.ndarray:
    """The value of each state [speed, lane] one second from now."""
    speeds, lanes, times = grid.shape
    earned = 0.4 * np.linspace(0, 1, speeds)[:, None] + 0.1 * np.linspace(0, 1, lanes)[None]
    value = np.zeros((speeds, lanes))
    for time in reversed(range(1, times)):
        ahead = np.full((speeds, lanes), -np.inf)
        for move in _MOVES:
            reached = np.array([[value[_after(move, v, i, grid.shape)] for i in range(lanes)] for v in range(speeds)])
            ahead = np.maximum(ahead, reached)
        value = earned - grid[..., time] + np.where(grid[..., time] >= 1.0, 0.0, ahead)
    return value


class RandomAgent:
    """Chooses actions uniformly at random."""

    def __init__(self) -> None:
        self.config: dict[str, Any] = {}

    def start(self, env: AbstractEnv, seed: int) -> None:
        """Seed the choice."""
        self._space = env.action_space
        self._space.seed(seed)

    def act(self, observation: Any) -> Any:
        """A sample of the action space."""
        return self._space.sample()


class PolicyAgent:
    """A user's policy: `predict(observation)` as in stable-baselines3, `act(observation)`, or a function.

    `act(observation, env)` gets a copy of the environment as well (`foreseen`), for searches that try actions in it.
    """

    def __init__(self, policy: Any, name: str) -> None:
        """Raises PlannerError for a `config` of unknown types, and for what is no policy."""
        self.config: dict[str, Any] = dict(getattr(policy, "config", {}))
        for part, factory in (("observation", observation_factory), ("action", action_factory)):
            _require_type(self.config, part, factory, name)
        self._policy, self._name, self._env = policy, name, None
        self._decide = self._search if _takes(getattr(policy, "act", None), "env") else _decision(policy, name)
        self._forget = getattr(policy, "reset", None)

    def start(self, env: AbstractEnv, seed: int) -> None:
        """Reset the policy if it has a method for that, and forget its state; otherwise it only sees observations.

        Raises PlannerError where the environment's spaces differ from those that the policy declares.
        """
        for name in ("observation_space", "action_space"):
            trained, there = getattr(self._policy, name, None), getattr(env, name)
            if isinstance(trained, gymnasium.Space) and _form(trained) != _form(there):
                raise PlannerError(
                    f"highway-env agent {self._name!r} was trained with {name} {trained}, here it is {there}: expected "
                    "the `config` of its training (env.unwrapped.config; that of a file is in the .json beside it), "
                    "and a policy that does itself what wrappers did"
                )
        if callable(self._forget):
            self._forget()
        if isinstance(self._decide, _Predicting):
            self._decide.state = None
        self._env: Any = env.unwrapped

    def act(self, observation: Any) -> Any:
        """The policy's action for an observation. Raises ValueError for none, and for one outside the action space."""
        action = self._decide(observation)
        if action is None or not np.isfinite(np.asarray(action, float)).all():  # highway-env would drive on without
            raise ValueError(f"highway-env agent {self._name!r} answered {action!r}, expected an action")
        if self._env is not None and (expected := _misses(action, self._env.action_space)):
            raise ValueError(
                f"highway-env agent {self._name!r} answered {reprlib.repr(action)}, expected {expected}, as in a "
                f"{self._env.config['action']['type']}: its `config` names the type of action that it answers, e.g. "
                '{"action": {"type": "DiscreteMetaAction"}}'
            )
        return action

    def _search(self, observation: Any) -> Any:
        return self._policy.act(observation, env=foreseen(self._env))


AGENTS: dict[str, Callable[[], HighwayAgent]] = {"idm": IDMAgent, "mdp": MDPAgent, "random": RandomAgent}


def find_agent(name: str) -> HighwayAgent:
    """Find an agent by name, or a policy as `package.module:attribute`, `path/to/file.py:attribute` or a model's file.

    Raises PlannerError where it cannot be found or is not a policy.
    """
    if name in AGENTS:
        return AGENTS[name]()
    made = foreign_code(lambda error: PlannerError(f"highway-env agent {name!r} cannot be made: {said_by(error)}"))
    if is_policy_file(name):
        with made:
            return PolicyAgent(FilePolicy(Path(name)), name)
    module_name, _, attribute = name.partition(":")
    if not attribute:
        raise PlannerError(
            f"highway-env agent {name!r} not found, {did_you_mean(name, sorted(AGENTS))} (or name your own: "
            "`package.module:attribute`, `file.py:attribute`, `file.zip` or `file.cleanrl_model`)"
        )
    found = getattr(import_named(module_name, f"agent {name!r}"), attribute, None)
    if found is None:
        raise PlannerError(f"highway-env agent {name!r}: {module_name} has no {attribute!r}")
    with made:
        return PolicyAgent(found() if isinstance(found, type) else found, name)


def _decision(policy: Any, name: str) -> Callable[[Any], Any]:
    if callable(getattr(policy, "predict", None)):
        return _Predicting(policy.predict)
    if callable(getattr(policy, "act", None)):
        return policy.act
    if callable(policy):
        return policy
    raise PlannerError(
        f"highway-env agent {name!r} is a {type(policy).__name__}, "
        "expected something with `predict(observation)` or `act(observation)`, or a function"
    )


class _Predicting:
    """Asks `predict`, which answers in stable-baselines3 with a state as well: what a recurrent policy remembers."""

    def __init__(self, predict: Callable[..., Any]) -> None:
        self._predict, self._keeps, self.state = predict, _takes(predict, "state"), None
        self._how = {"deterministic": True} if _takes(predict, "deterministic") else {}

    def __call__(self, observation: Any) -> Any:
        """The action."""
        state = {} if self.state is None else {"state": self.state}
        answer = self._predict(observation, **self._how, **state)
        if not (isinstance(answer, tuple) and len(answer) == 2):
            return answer
        self.state = answer[1] if self._keeps else None
        return answer[0]


def _takes(function: Any, name: str) -> bool:
    """Whether a function has a parameter of that name, or accepts any keyword."""
    try:
        parameters = inspect.signature(function).parameters
    except (TypeError, ValueError):  # functions written in C
        return False
    return name in parameters or any(one.kind is one.VAR_KEYWORD for one in parameters.values())


def _misses(action: Any, space: Any) -> str:
    """What is expected of an action; empty where it is in the space, whose bounds highway-env itself keeps."""
    if isinstance(space, Discrete):
        fits = np.size(action) == 1 and np.asarray(action).item() in range(int(space.n))
        return "" if fits else f"a whole number from 0 to {space.n - 1}"
    return f"numbers of shape {list(space.shape)}" if isinstance(space, Box) and np.shape(action) != space.shape else ""


def _require_type(config: dict[str, Any], part: str, factory: Any, name: str) -> None:
    known = re.findall(r'config\["type"\] == "(\w+)"', inspect.getsource(factory))
    given = config.get(part, {"type": known[0]})
    kind = given.get("type") if isinstance(given, dict) else given
    if kind not in known:
        raise PlannerError(
            f"highway-env agent {name!r}: the type of {part} in its `config` is {kind!r}, "
            f"{did_you_mean(str(kind), known)}"
        )


def _form(space: Any) -> tuple[Any, ...]:
    """The attributes of a space that a policy depends on."""
    return type(space).__name__, space.shape, getattr(space, "n", None)


def _idle_action(env: Any) -> Any:
    """An action of the environment that changes nothing."""
    indexes = getattr(env.action_type, "actions_indexes", None)
    if indexes is not None:
        return indexes["IDLE"]
    space = env.action_space
    return np.zeros(space.shape, np.float32) if space.shape else int(space.n) // 2
