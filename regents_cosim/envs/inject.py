"""Injects the recorded adversary of a case into an existing environment of highway-env."""

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from highway_env.envs.common.abstract import AbstractEnv
from highway_env.road.road import Road
from highway_env.vehicle.kinematics import Vehicle

from regents_cosim.errors import RegentsError, require
from regents_cosim.geometry.boxes import Boxes, overlap
from regents_cosim.replays.episode import choose_case
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.simulators.highway import skip_wayland
from regents_cosim.simulators.highway.cast import ScriptedVehicle
from regents_cosim.simulators.highway.environments import hide_roles

skip_wayland()

_ROUNDED = 1e-5  # of a step

Who = Literal["adversary", "background"]


def highway_env_in(env: gymnasium.Env[Any, Any]) -> AbstractEnv:
    """The environment of highway-env that `env` wraps. Raises RegentsError where it is none."""
    host = env.unwrapped
    if not isinstance(host, AbstractEnv):
        raise RegentsError(f"{host} is not an environment of highway-env")
    return host


class InjectScenario(gymnasium.Wrapper, RecordConstructorArgs):
    """Adds the adversary of a case to `env` at every reset; it stays on its track even after a contact.

    The case must have been recorded on the map of `env`. With `who` background all but the ego are added. Vehicles of
    the environment that stand in the way of an entering vehicle are removed. `reset` takes the options `case` and
    `suite`, as in the replay environment; without either no vehicle is added. `gymnasium.make(env.spec)` makes an equal
    wrapper.
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        case: Path | str | Scenario | None = None,
        suite: Path | str | None = None,
        who: Who = "adversary",
    ) -> None:
        """Raises RegentsError where `env` is not an environment of highway-env."""
        # Paths are kept as text, so that a spec can be written as JSON; a case in memory is immutable and cannot be
        # written.
        given = {"case": case, "suite": suite, "who": who}
        given = {name: str(value) if isinstance(value, Path) else value for name, value in given.items()}
        RecordConstructorArgs.__init__(self, _disable_deepcopy=True, **given)
        gymnasium.Wrapper.__init__(self, env)
        require(who in ("adversary", "background"), f"who {who!r}, expected adversary or background", RegentsError)
        self._host, self._who = highway_env_in(env), who
        self._default = {"case": case, "suite": suite}
        self._rng = np.random.default_rng(0)
        self.injected: list[InjectedVehicle] = []

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset `env`, then put the vehicles on its road."""
        mine = {name: value for name, value in (options or {}).items() if name in ("case", "suite")}
        others = {name: value for name, value in (options or {}).items() if name not in mine}
        observation, info = self.env.reset(seed=seed, options=others or None)
        if seed is not None:
            self._rng = np.random.default_rng(seed)
        asked = mine or self._default
        if not any(asked.values()):
            self.injected = []
            return observation, info
        scenario = choose_case(asked.get("case"), asked.get("suite"), self._rng)
        road: Any = self._host.road
        self.injected = [InjectedVehicle(road, scenario, row) for row in self._members(scenario)]
        hide_roles(self._host, self.injected)
        self._call(road)
        road.step = partial(self._step, road, road.step)  # no closure: copies and pickles step their own road
        return self._host.observation_type.observe(), info | {"case": scenario.id}

    def _members(self, scenario: Scenario) -> list[int]:
        roles = ("adversary", "background") if self._who == "background" else ("adversary",)
        rows = [i for i, agent in enumerate(scenario.agents) if i and agent.role in roles]
        require(bool(rows), f"case {scenario.id} has no {self._who} to inject", RegentsError)
        return rows

    def _step(self, road: Road, step: Callable[[float], None], dt: float) -> None:
        """A step of `road`: the injected vehicles are added or removed, and their time goes on."""
        for vehicle in self.injected:
            vehicle.time_s += dt
        self._call(road)
        step(dt)

    def _call(self, road: Road) -> None:
        """Add the injected vehicles that are present now, remove absent ones and vehicles in their way."""
        others = [vehicle for vehicle in road.vehicles if vehicle not in self.injected]
        there = [vehicle for vehicle in self.injected if vehicle.present]
        for vehicle in there:
            if vehicle not in road.vehicles:
                vehicle.place()
                others = [o for o in others if o in self._host.controlled_vehicles or not _touch(o, vehicle)]
        road.vehicles = [*others, *there]


class InjectedVehicle(ScriptedVehicle):
    """A scripted vehicle that follows time instead of steps, since the host's steps may have any length."""

    def __init__(self, road: Road, scenario: Scenario, row: int) -> None:
        self.time_s = 0.0
        self._steps = np.flatnonzero(scenario.tracks.valid[row])
        self._dt = scenario.dt
        super().__init__(road, scenario, row)
        self.states[2, self._steps] = np.unwrap(self.states[2, self._steps])
        self.check_collisions = True  # anything that it touches has crashed

    @property
    def present(self) -> bool:
        """Whether its track covers this time: it is there at the steps before and after."""
        now = self.time_s / self._dt
        around = {math.floor(now + _ROUNDED), math.ceil(now - _ROUNDED)}
        return max(around) < len(self.valid) and bool(self.valid[list(around)].all())

    def step(self, dt: float) -> None:
        """Take the pose that the track has now."""
        self.place()

    def place(self) -> None:
        """Interpolate linearly between two steps of the track."""
        now = self.time_s / self._dt
        x, y, heading, speed = (np.interp(now, self._steps, values[self._steps]) for values in self.states)
        self.position = np.array([x, y])
        self.heading, self.speed = float(heading), float(speed)
        self.impact = None


def _touch(a: Vehicle, b: Vehicle) -> bool:
    """Whether two boxes overlap, by the same rule as elsewhere, in highway-env's plane."""
    first, second = (Boxes(v.position[0], v.position[1], v.heading, v.LENGTH, v.WIDTH) for v in (a, b))
    return bool(overlap(first, second))
