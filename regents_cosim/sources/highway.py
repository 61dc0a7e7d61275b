"""Scenarios from highway-env: any of its environments, its controlled vehicle driven by any policy.

Episodes run at 10 Hz, the policy decides as often as the environment says, and every frame is read. Each episode gives
one window at most, whose ego is the controlled vehicle.
"""

import hashlib
import json
import random
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from highway_env.envs.common.abstract import AbstractEnv
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.objects import RoadObject

from regents_cosim.errors import NoWindowError, PlannerError, RegentsError, require
from regents_cosim.geometry.frames import HighwayPose, from_highway
from regents_cosim.scenario.scenario import Kind, Scenario
from regents_cosim.simulators import STEP_S
from regents_cosim.simulators.highway import after_each_step
from regents_cosim.simulators.highway.agents import IDM_PARAMETERS, HighwayAgent, find_agent
from regents_cosim.simulators.highway.environments import find_environment, make_environment, require_rate
from regents_cosim.simulators.highway.net import road_map_of
from regents_cosim.simulators.highway.own_motion import EXACT_M, controls_behind
from regents_cosim.simulators.sumo.types import TRUCK_M, VehicleType
from regents_cosim.sources.logs.kinds import kind_named
from regents_cosim.sources.recording import Recording, gathered
from regents_cosim.sources.windows import USUAL, RecordingOrigin, Windows, egos, make_scenario, why_none
from regents_cosim.system.foreign_code import foreign_code, said_by
from regents_cosim.system.process_kept import process_kept
from regents_cosim.system.workers import result_of, run_isolated, submit

_LATEST_BEGIN_S = 4.0  # latest begin of a window in its episode


def record_highway(
    environment: str, policy: str = "idm", windows: Windows = USUAL, executor: Executor | None = None
) -> list[Scenario]:
    """Up to `windows.count` Scenarios out of as many episodes of `environment`; the same seed gives the same ones.

    `policy` drives the ego: idm, mdp, random, `package.module:attribute` or `file.py:attribute`. Raises RegentsError
    for an environment that does not exist, PlannerError for a policy that cannot be found, NoWindowError where no
    episode holds a window.
    """
    with process_kept():  # fail here rather than in the worker
        find_agent(policy)
        find_environment(environment)
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

    def failed(error: BaseException) -> PlannerError:
        return PlannerError(f"policy {policy} cannot drive in {environment} ({said_by(error)})")

    with foreign_code(failed):
        env = _make(environment, agent)
        what = json.dumps({"policy": policy, **env.config}, sort_keys=True, default=str)
    origin = RecordingOrigin("highway", environment.rpartition(":")[2], hashlib.sha256(what.encode()).hexdigest())
    most = 4 * windows.count + 8
    found: list[Scenario] = []
    recordings: list[Recording] = []
    refused: Counter[str] = Counter()
    for episode in range(most):
        with foreign_code(failed):
            recording = _run_episode(env, agent, windows, episode)
        if recording is None:
            continue
        recordings.append(recording)
        road = road_map_of(_road(env).network)
        for ego in egos(recording, road, windows, np.arange(len(recording.ids)), refused):
            found.append(make_scenario(recording, ego, road, origin, windows, Counter()))
        if len(found) == windows.count:
            break
    env.close()
    if not recordings:
        raise NoWindowError(
            f"no window found: {most} of {most} episodes ended before {windows.horizon_s:g} s "
            f"in {environment} under policy {policy} (try a shorter `horizon` or another `policy`)"
        )
    if not found:
        raise NoWindowError(why_none(recordings, refused, windows))
    return found


def _make(name: str, agent: HighwayAgent) -> AbstractEnv:
    """The environment, running at 10 Hz."""
    env, frequency = make_environment(name, agent.config), round(1.0 / STEP_S)
    # A recording needs no reward, and those of merges and roundabouts fail on continuous actions.
    kind = type(env)
    forgiving = {"_reward": _or(0.0, kind._reward), "_rewards": _or({}, kind._rewards)}
    env.__class__ = type(kind.__name__, (kind,), forgiving)  # not on the instance, for a search copies it
    if "policy_frequency" in agent.config:
        require_rate(agent.config["policy_frequency"], frequency)
    elif frequency % env.config["policy_frequency"]:
        slower = range(1, int(env.config["policy_frequency"]) + 1)
        env.configure({"policy_frequency": max((rate for rate in slower if frequency % rate == 0), default=1)})
    env.configure({"simulation_frequency": frequency})
    return env


def _or(otherwise: Any, method: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    def called(env: Any, action: Any) -> Any:
        with suppress(Exception):
            return method(env, action)
        return otherwise

    return called


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
        for item in (one for one in [*road.vehicles, *road.objects] if one.solid and one.collidable):
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
        # A continuous action sets the steering angle at once, so a vehicle may go another way from step to step.
        lengths = np.array([self.types[name].length for name in ids])
        _, missed = controls_behind(x, y, yaw, speed, lengths, dt)
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
            driven=np.abs(missed) < EXACT_M,
            egos=frozenset({f"e{self.episode:03d}.ego"}),
        )

    def _name(self, item: RoadObject, env: AbstractEnv) -> str:
        if id(item) not in self._names:
            self._seen.append(item)
            kind = _kind(item)
            label = "ego" if item is env.vehicle else f"{'object' if kind == 'other' else kind}{len(self._names):03d}"
            self._names[id(item)] = name = f"e{self.episode:03d}.{label}"
            self.types[name] = VehicleType(kind, float(item.LENGTH), float(item.WIDTH))
        return self._names[id(item)]


def _kind(item: RoadObject) -> Kind:
    """The kind of a road user by the name of its class or of a base class, such as Pedestrian; a Vehicle is a car."""
    for base in type(item).__mro__:
        kind = kind_named(base.__name__)
        if kind != "other":
            return "truck" if kind == "car" and item.LENGTH >= TRUCK_M else kind
    return "other"


def _run_episode(env: AbstractEnv, agent: HighwayAgent, windows: Windows, episode: int) -> Recording | None:
    """The window of one episode; None where it ended too early."""
    rng = np.random.default_rng([windows.seed, episode])
    seed = int(rng.integers(2**31))
    random.seed(seed)  # some environments draw from these, whatever seed they get
    np.random.seed(seed)
    observation, _ = env.reset(seed=seed)
    require(
        len(env.controlled_vehicles) == 1,
        f"{type(env).__name__} has {len(env.controlled_vehicles)} controlled vehicles, expected one, the ego: give it "
        "`controlled_vehicles` 1, and types of observation and action of one agent",
        RegentsError,
    )
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
