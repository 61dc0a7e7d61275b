"""Attacks the driving policy in the live traffic of any environment of highway-env."""

from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium
from gymnasium.utils import RecordConstructorArgs

from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.envs.highway_host import HighwayHost, Spare
from regents_cosim.envs.inject import highway_env_in
from regents_cosim.live.attacker import AttackCounts, Attacker
from regents_cosim.live.host.interface import History
from regents_cosim.live.predict.moments import Moments
from regents_cosim.live.predict.traffic_ahead import CarFollowingPredictor
from regents_cosim.live.search.plans import Search
from regents_cosim.live.search.replanner import Replanner
from regents_cosim.live.settings import LiveSettings, live_config
from regents_cosim.mirror.programs.forked import require_own_threads
from regents_cosim.planners.under_test import AnyPlanner
from regents_cosim.replays.episode import AttackedEpisodes
from regents_cosim.system.progress import DOING, progress_for


class LiveAdversary(gymnasium.Wrapper, RecordConstructorArgs):
    """Attacks the ego of `env` in one of `every` episodes: another vehicle drives so that a crash threatens.

    The adversary is one of the environment's own vehicles, and drives by itself again afterwards. `planner` predicts
    how the ego reacts: any planner that `regents attack` takes, or `observed`, an ego that keeps to its lane at its
    recent speed and brakes for leaders. Every `replan_s` [s] a search without samples (`live.settings.live_config`)
    makes a plan, since many episodes are to be driven.

    `info` has `attacked` (whether this episode is attacked), `adversary` (the name of the vehicle that attacks now, or
    empty), and `attacks` (the number of attacks so far). Vehicles are numbered in the order in which they come near the
    ego.

    The user's other agents (`controlled_vehicles`) never attack, nor do vehicles that `spare` names: by their names in
    `info`, by the names of their classes, or by a function that takes a vehicle of highway-env and returns a bool.
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        method: str | AttackConfig = "focused-live",
        every: int = 1,
        planner: AnyPlanner = "observed",
        replan_s: float = 0.5,
        horizon_s: float = 5.0,
        radius_m: float = 100.0,
        spare: Spare = (),
    ) -> None:
        """Raises RegentsError where `env` is not an environment of highway-env, and for invalid values."""
        given = {"method": method, "every": every, "planner": planner}
        given |= {"replan_s": replan_s, "horizon_s": horizon_s, "radius_m": radius_m, "spare": spare}
        RecordConstructorArgs.__init__(self, _disable_deepcopy=True, **given)
        gymnasium.Wrapper.__init__(self, env)
        self._env = highway_env_in(env)
        self._settings = LiveSettings(replan_s, horizon_s, radius_m)
        self._episodes, self._spare = AttackedEpisodes(every), spare
        self._search = Search(planner, live_config(method, samples=False))
        self._moments = Moments(CarFollowingPredictor(), horizon_s)
        self._tally = AttackCounts()
        self._pilot: _Pilot | None = None
        DOING.tell_once(progress_for(True).say)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset `env`; a seed also draws which of the following episodes are attacked.

        Raises RegentsError in a process that was forked from one in which JAX has run.
        """
        require_own_threads()
        observation, info = self.env.reset(seed=seed, options=options)
        self._tally, self._pilot = AttackCounts(), None
        if self._episodes.begin(seed):
            self._pilot = self._new_pilot()
            road: Any = self._env.road
            road.step = partial(self._pilot.step, road.step)
        return observation, info | self._said()

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step `env`, with the adversary's move."""
        require_own_threads()
        observation, reward, terminated, truncated, info = self.env.step(action)
        return observation, reward, terminated, truncated, info | self._said()

    def close(self) -> None:
        """Close `env`, and end the planner's process, if any."""
        self._search.close()
        self.env.close()

    def _new_pilot(self) -> "_Pilot":
        """A new pilot without memory of earlier episodes."""
        self._search.forget()
        self._moments.forget()
        host = HighwayHost(self._env, self._settings.radius_m, self._spare)
        history = History(self._settings.horizon_s, host.step_s)
        replanner = Replanner(host, self._search, self._moments, history)
        return _Pilot(host, history, Attacker(host, replanner, self._settings.replan_s, self._tally, lambda *_: None))

    def _said(self) -> dict[str, Any]:
        attack = self._pilot.attacker.attack if self._pilot is not None else None
        name = attack.plan.adversary if attack is not None else ""
        return {"attacked": self._pilot is not None, "adversary": name, "attacks": self._tally.attacks}


class _Pilot:
    """Shows the attacker every step of a road, and moves the adversary before it."""

    def __init__(self, host: HighwayHost, history: History, attacker: Attacker) -> None:
        self._host, self._history, self.attacker = host, history, attacker
        self._time_s = 0.0

    def step(self, step: Callable[[float], None], dt: float) -> None:
        """Make one step of the road by calling highway-env's `step`."""
        frame = self._host.frame(self._time_s)
        self._history.frames.append(frame)
        self.attacker.step(frame, lambda: True)
        step(dt)
        self._time_s += dt
