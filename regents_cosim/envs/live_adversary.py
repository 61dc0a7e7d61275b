"""An adversary in the live traffic of any environment of highway-env: the policy that drives is attacked as it is."""

from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium
from gymnasium.utils import RecordConstructorArgs
from highway_env.envs.common.abstract import AbstractEnv

from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.envs.attacked_episodes import AttackedEpisodes
from regents_cosim.envs.highway_host import HighwayHost, Spare
from regents_cosim.errors import RegentsError, require
from regents_cosim.live.attacker import Attacker, Tally
from regents_cosim.live.history import History
from regents_cosim.live.moments import Moments
from regents_cosim.live.predict import Mirror
from regents_cosim.live.replanner import Replanner
from regents_cosim.live.search import Search
from regents_cosim.live.settings import LiveSettings, live_config
from regents_cosim.mirror.forked import require_own_threads
from regents_cosim.planners.under_test import AnyPlanner
from regents_cosim.system.progress import DOING, shown


class LiveAdversary(gymnasium.Wrapper, RecordConstructorArgs):
    """Attacks the ego of `env` in one of `every` episodes: one of the others drives so that a crash threatens.

    The adversary is one of the environment's own vehicles, which drives again by itself afterwards. How the ego
    reacts is predicted by `planner`: all that `regents attack` takes, or `observed`, an ego that keeps to its lane at
    its recent speed and brakes for leaders. A plan is made every `replan_s`, by a search
    without samples (`live.settings.live_config`): many episodes are to be driven.

    `info` has `attacked`, whether this is an episode with attacks, `adversary`, the name of the vehicle that attacks
    now or empty, and `attacks`, how many have begun. Vehicles are named in the order in which they come near the ego.

    Other agents of yours (`controlled_vehicles`) never attack, nor do those that `spare` tells: vehicles by their names
    in `info` or those of their classes, or a function of one of highway-env's vehicles that says whether it is spared.
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        method: str | AttackConfig = "focused",
        every: int = 1,
        planner: AnyPlanner = "observed",
        replan_s: float = 0.5,
        horizon_s: float = 5.0,
        radius_m: float = 100.0,
        spare: Spare = (),
    ) -> None:
        """Raises RegentsError where `env` is none of highway-env's, and for values that cannot be meant."""
        given = {"method": method, "every": every, "planner": planner}
        given |= {"replan_s": replan_s, "horizon_s": horizon_s, "radius_m": radius_m, "spare": spare}
        RecordConstructorArgs.__init__(self, _disable_deepcopy=True, **given)
        gymnasium.Wrapper.__init__(self, env)
        host = env.unwrapped
        require(isinstance(host, AbstractEnv), f"{host} is no environment of highway-env", RegentsError)
        assert isinstance(host, AbstractEnv)
        self._settings = LiveSettings(replan_s, horizon_s, radius_m)
        self._env, self._episodes, self._spare = host, AttackedEpisodes(every), spare
        self._search = Search(planner, live_config(method, samples=False))
        self._moments = Moments(Mirror(), horizon_s)
        self._tally = Tally()
        self._pilot: _Pilot | None = None
        DOING.tell_once(shown(True).say)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset `env`; with a seed, which of the following episodes are attacked is drawn by it.

        Raises RegentsError in a process that was forked from one in which JAX was at work.
        """
        require_own_threads()
        observation, info = self.env.reset(seed=seed, options=options)
        self._tally, self._pilot = Tally(), None
        if self._episodes.begin(seed):
            self._pilot = self._new_pilot()
            road: Any = self._env.road
            road.step = partial(self._pilot.step, road.step)
        return observation, info | self._said()

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """One step of `env`."""
        require_own_threads()
        observation, reward, terminated, truncated, info = self.env.step(action)
        return observation, reward, terminated, truncated, info | self._said()

    def close(self) -> None:
        """Close `env`, and end the planner's process, if any."""
        self._search.close()
        self.env.close()

    def _new_pilot(self) -> "_Pilot":
        """One that knows nothing of the episodes before."""
        self._search.forget()
        self._moments.forget()
        host = HighwayHost(self._env, self._settings.radius_m, self._spare)
        history = History(self._settings.horizon_s, host.step_s)
        replanner = Replanner(host, self._search, self._moments, history)
        return _Pilot(host, history, Attacker(host, replanner, self._settings.replan_s, self._tally, _nothing))

    def _said(self) -> dict[str, Any]:
        attack = self._pilot.attacker.attack if self._pilot is not None else None
        name = attack.plan.adversary if attack is not None else ""
        return {"attacked": self._pilot is not None, "adversary": name, "attacks": self._tally.attacks}


class _Pilot:
    """Lets the attacker see every step of a road, and drive before it."""

    def __init__(self, host: HighwayHost, history: History, attacker: Attacker) -> None:
        self._host, self._history, self.attacker = host, history, attacker
        self._time_s = 0.0

    def step(self, step: Callable[[float], None], dt: float) -> None:
        """One step of the road, as highway-env makes it by `step`."""
        frame = self._host.frame(self._time_s)
        self._history.add(frame)
        self.attacker.step(frame, _always)
        step(dt)
        self._time_s += dt


def _always() -> bool:
    return True


def _nothing(*_: Any) -> None:
    """What happens there is told by `info`."""
