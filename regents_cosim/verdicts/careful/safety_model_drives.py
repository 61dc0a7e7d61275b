"""The drives of the fuzzy safety model and of RSS in the ego's place, step by step along the ego's path."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from regents_cosim.judgement import ReferenceDriver
from regents_cosim.norms.safety_models import FUZZY, RSS, NearbyRoadUser, fuzzy_braking, rss_braking
from regents_cosim.scenario import Scenario
from regents_cosim.verdicts.careful.ego_path import EgoPath
from regents_cosim.verdicts.careful.others_around import beyond_steps

WantedBraking = Callable[[float, float, NearbyRoadUser], float]


@dataclass(frozen=True)
class SafetyModel:
    """A model that says how hard to brake, with the delay and build-up of its brakes."""

    driver: ReferenceDriver
    wanted: WantedBraking  # [m/s^2] from the ego's speed, its acceleration, and the adversary's position
    delay_s: float
    jerk_m_s3: float


SAFETY_MODELS = (
    SafetyModel("fuzzy", lambda *at: float(fuzzy_braking(np, *at)), FUZZY.delay_s, FUZZY.jerk_m_s3),
    SafetyModel("rss", lambda speed, _, other: float(rss_braking(np, speed, other)), RSS.delay_s, RSS.jerk_m_s3),
)


@dataclass(frozen=True, eq=False)
class BrakedDrive:
    """The speeds of a drive, the steps at which it perceived the danger and began to brake; None: never."""

    speed: Float[np.ndarray, " step"]  # [m/s]
    perceived: int | None
    acts: int | None


def braked_by(model: SafetyModel, scenario: Scenario, path: EgoPath, adversary: int, until: int) -> BrakedDrive:
    """The ego's own speeds until the model has perceived a danger before step `until` and reacted, then its braking.

    Once it has begun, it brakes as hard as the model wants, holds the speed where the model wants nothing, and never
    brakes less than the ego did.
    """
    own, dt, steps = scenario.tracks.speed[0], scenario.dt, beyond_steps(scenario)
    seen = _Adversary(scenario, path, adversary)
    perceived = next((k for k in range(until) if seen.braking(model, k, path.driven[k], own) > 0.0), None)
    acts = None if perceived is None else perceived + round(model.delay_s / dt)
    if acts is None or acts >= until:
        return BrakedDrive(own, perceived, None)
    speed, distance, braking = [*own[: acts + 1].tolist()], float(path.driven[acts]), 0.0
    for step in range(acts, steps - 1):
        wanted = seen.braking(model, step, distance, np.array(speed))
        braking = min(braking + model.jerk_m_s3 * dt, wanted)
        own_braking = (own[step] - own[step + 1]) / dt if step + 1 < len(own) else 0.0
        speed.append(max(speed[-1] - dt * max(braking, own_braking), 0.0))
        distance += 0.5 * (speed[-1] + speed[-2]) * dt
    return BrakedDrive(np.array(speed), perceived, acts)


class _Adversary:
    """The adversary's position relative to the ego's path at every step; beyond the horizon it goes straight on."""

    def __init__(self, scenario: Scenario, path: EgoPath, adversary: int) -> None:
        tracks, agent, ego = scenario.tracks, scenario.agents[adversary], scenario.ego
        ahead = scenario.dt * np.arange(1, beyond_steps(scenario) - tracks.steps + 1)
        speed, yaw, there = (
            np.append(values[adversary], np.full(len(ahead), values[adversary, -1]))
            for values in (tracks.speed, tracks.yaw, tracks.valid)
        )
        x = np.append(tracks.x[adversary], tracks.x[adversary, -1] + speed[-1] * np.cos(yaw[-1]) * ahead)
        y = np.append(tracks.y[adversary], tracks.y[adversary, -1] + speed[-1] * np.sin(yaw[-1]) * ahead)
        self._along, across, way = path.project(x, y)
        cos, sin = np.cos(yaw - way), np.sin(yaw - way)
        self._reach = 0.5 * (np.abs(cos) * agent.length + np.abs(sin) * agent.width + ego.length)
        breadth = 0.5 * (np.abs(sin) * agent.length + np.abs(cos) * agent.width + ego.width)
        self._beside = np.abs(across) - breadth
        self._speed, self._towards = speed * cos, -np.sign(across) * speed * sin
        self._there, self._dt = there.astype(bool), scenario.dt

    def braking(self, model: SafetyModel, step: int, distance: float, speeds: np.ndarray) -> float:
        """The braking [m/s^2] that the model wants at a step, for an ego at `distance` [m] with `speeds` until then."""
        if not self._there[step]:
            return 0.0
        away = float(self._along[step] - distance)
        other = NearbyRoadUser(
            gap_m=away - self._reach[step],
            passing_m=away + self._reach[step],
            beside_m=self._beside[step],
            speed=self._speed[step],
            towards=self._towards[step],
            ahead=away > 0.0,
        )
        accel = (speeds[step] - speeds[step - 1]) / self._dt if step else 0.0
        return model.wanted(float(speeds[step]), float(accel), other)
