"""Scenarios from highway-env: any of its environments, its controlled vehicle driven by any policy.

Episodes run at 10 Hz, the policy decides as often as the environment says, and every frame is read. Each episode gives
one window at most, whose ego is the controlled vehicle.
"""

import hashlib
import json
import warnings
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from typing import Any

import gymnasium
import highway_env
import numpy as np
from highway_env.envs.common.abstract import AbstractEnv
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.objects import Landmark, RoadObject

from regents_cosim.checks.names import did_you_mean
from regents_cosim.errors import NoWindowError, PlannerError, RegentsError
from regents_cosim.geometry.frames import HighwayPose, from_highway
from regents_cosim.scenario import Scenario
from regents_cosim.simulators import STEP_S
from regents_cosim.simulators.highway import after_each_step
from regents_cosim.simulators.highway.agents import IDM_PARAMETERS, HighwayAgent, find_agent
from regents_cosim.simulators.highway.net import to_road_map
from regents_cosim.simulators.sumo.types import TRUCK_M, VehicleType
from regents_cosim.sources.recording import Recording, gathered
from regents_cosim.sources.windows import USUAL, RecordingOrigin, Windows, choose_windows
from regents_cosim.system.foreign_code import foreign_code, said_by
from regents_cosim.system.workers import result_of, run_isolated, submit

_LATEST_BEGIN_S = 4.0  # latest begin of a window in its episode


def environments() -> list[str]:
    """Ids of highway-env's environments that have one controlled vehicle."""
    highway_env._register_highway_envs()
    own = [name for name, spec in gymnasium.registry.items() if str(spec.entry_point).startswith("highway_env")]
    return sorted(name for name in own if "multi-agent" not in name)


def record_highway(
    environment: str,
    policy: str = "idm",
    windows: Windows = USUAL,
    executor: Executor | None = None,
) -> list[Scenario]:
    """Up to `windows.count` Scenarios out of as many episodes of `environment`; the same seed gives the same ones.

    `policy` drives the ego: idm, mdp, random, `package.module:attribute` or `file.py:attribute`. Raises RegentsError
    for an environment that does not exist, PlannerError for a policy that cannot be found, NoWindowError where no
    episode holds a window.
    """
    find_agent(policy)  # fail here rather than in the worker
    known = environments()
    if environment not in known:
        raise RegentsError(f"highway-env has no environment {environment!r}: {did_you_mean(environment, known)}")
    # One other vehicle is enough traffic, since racetrack has no more. There is one ego, so none is preferred.
    job = environment, policy, replace(windows, company=1, prefer="conflicts")
    if executor is None:
        return run_isolated(record_episodes, *job)
    return result_of(submit(executor, record_episodes, *job))


def record_episodes(environment: str, policy: str, windows: Windows) -> list[Scenario]:
    """Run episodes until enough windows are found. Call it in a worker process."""
    for name, value in IDM_PARAMETERS.items():
        setattr(IDMVehicle, name, value)
    agent = find_agent(policy)
    env = _make(environment, agent)
    what = json.dumps({"policy": policy, **env.config}, sort_keys=True, default=str)
    origin = RecordingOrigin("highway", environment, hashlib.sha256(what.encode()).hexdigest())
    most = 4 * windows.count + 8
    road = to_road_map(_road(env).network)  # the same in all episodes
    kept, refused = [], []

    def failed(error: BaseException) -> PlannerError:
        return PlannerError(f"policy {policy} cannot drive in {environment} ({said_by(error)})")

    for episode in range(most):
        with foreign_code(failed):
            recording = _run_episode(env, agent, windows, episode)
        if recording is None:
            continue
        try:
            choose_windows([recording], road, origin, replace(windows, count=1))
        except NoWindowError:
            refused.append(recording)
            continue
        kept.append(recording)
        if len(kept) == windows.count:
            break
    env.close()
    if not kept and not refused:
        raise NoWindowError(
            f"no window found: {most} of {most} episodes ended before {windows.horizon_s:g} s "
            f"in {environment} under policy {policy} (try a shorter `horizon` or another `policy`)"
        )
    return choose_windows(kept or refused, road, origin, windows)


def _make(name: str, agent: HighwayAgent) -> AbstractEnv:
    """The environment, running at 10 Hz."""
    environments()
    config: dict[str, Any] = {"simulation_frequency": round(1.0 / STEP_S), **agent.config}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # environments with a newer version warn about it
            env = gymnasium.make(name, config=config, disable_env_checker=True).unwrapped
    except TypeError as error:
        raise RegentsError(f"{name} cannot be configured, so nothing can be recorded there") from error
    assert isinstance(env, AbstractEnv)
    return env


# --- episodes ---------------------------------------------------------------------------------


@dataclass
class _TrackHistory:
    """The motion of every vehicle and obstacle, frame by frame."""

    episode: int
    frames: list[dict[str, tuple[float, float, float, float]]] = field(default_factory=list)
    types: dict[str, VehicleType] = field(default_factory=dict)
    _names: dict[int, str] = field(default_factory=dict)
    _seen: list[RoadObject] = field(default_factory=list)  # kept alive, so that no id() is used twice

    def take(self, env: AbstractEnv) -> None:
        """Record the current frame."""
        frame, road = {}, _road(env)
        for item in [*road.vehicles, *(o for o in road.objects if not isinstance(o, Landmark))]:
            x, y = item.position.tolist()
            pose = from_highway(HighwayPose(x, y, float(item.heading)))
            # highway-env's vehicles may creep backwards; here they stand
            frame[self._name(item, env)] = (*pose, max(float(item.speed), 0.0))
        self.frames.append(frame)

    def recording(self, steps: int, dt: float) -> Recording | None:
        """The last `steps` frames; None where there are fewer."""
        begin = len(self.frames) - steps
        if begin < 0:
            return None
        frames = self.frames[begin:]
        rows = [(name, step, *state) for step, frame in enumerate(frames) for name, state in frame.items()]
        ids, valid, (x, y, yaw, speed) = gathered(rows, steps)
        return Recording(
            begin_s=round(begin * dt, 6),
            dt=dt,
            ids=ids,
            types=tuple(self.types[name] for name in ids),
            x=x,
            y=y,
            yaw=yaw,
            valid=valid,
            given_speed=speed,
            egos=frozenset({f"e{self.episode:03d}.ego"}),
        )

    def _name(self, item: RoadObject, env: AbstractEnv) -> str:
        if id(item) not in self._names:
            self._seen.append(item)
            is_vehicle = item in _road(env).vehicles
            label = "ego" if item is env.vehicle else f"{'car' if is_vehicle else 'object'}{len(self._names):03d}"
            self._names[id(item)] = name = f"e{self.episode:03d}.{label}"
            kind = ("truck" if item.LENGTH >= TRUCK_M else "car") if is_vehicle else "other"
            self.types[name] = VehicleType(kind, float(item.LENGTH), float(item.WIDTH))
        return self._names[id(item)]


def _run_episode(env: AbstractEnv, agent: HighwayAgent, windows: Windows, episode: int) -> Recording | None:
    """The window of one episode; None where it ended too early."""
    rng = np.random.default_rng([windows.seed, episode])
    seed = int(rng.integers(2**31))
    observation, _ = env.reset(seed=seed)
    agent.start(env, seed)
    steps = windows.steps(STEP_S)
    wanted = steps + int(rng.integers(round(_LATEST_BEGIN_S / STEP_S)))
    film = _TrackHistory(episode)
    film.take(env)
    after_each_step(_road(env), lambda: film.take(env))
    ended = False
    while not ended and len(film.frames) < wanted:
        observation, _, terminated, truncated, _ = env.step(agent.act(observation))
        ended = terminated or truncated
    film.frames = film.frames[:wanted]
    return film.recording(steps, STEP_S)


def _road(env: AbstractEnv) -> Any:
    """The road of an environment, which exists after a reset."""
    return env.road
