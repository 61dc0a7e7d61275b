"""Measures whether an adversary still moves like the traffic that it comes from.

Motion is computed by finite differences of speed and yaw between valid steps, in the same way for logged and attacked
tracks: acceleration and yaw rate belong to the middle of a step, jerk to the instant between two steps.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float
from scipy.stats import wasserstein_distance

from regents_cosim.geometry.boxes import Boxes
from regents_cosim.geometry.frames import wrap
from regents_cosim.judgement import Flaw
from regents_cosim.scenario import Scenario, Tracks, boxes_of
from regents_cosim.verdicts.clean import flaws
from regents_cosim.verdicts.leaving_road import corners_off_road

Samples = Float[np.ndarray, " _"]

PERCENTILES = (1, 5, 50, 95, 99)


@dataclass(frozen=True)
class DryRoadLimits:
    """The highest magnitudes for a car on a dry road."""

    accel: float = 6.0  # [m/s^2] the attack's own limit
    lateral: float = 6.0  # [m/s^2]
    jerk: float = 15.0  # [m/s^3]
    yaw_rate: float = 0.8  # [rad/s]


@dataclass(frozen=True, eq=False)
class MotionSamples:
    """Samples of the motion of some agents, from all their valid steps."""

    accel: Float[np.ndarray, " sample"]  # [m/s^2] along the heading
    lateral: Float[np.ndarray, " sample"]  # [m/s^2] speed times yaw rate
    jerk: Float[np.ndarray, " instant"]  # [m/s^3] along the heading
    yaw_rate: Float[np.ndarray, " sample"]  # [rad/s]


@dataclass(frozen=True)
class Quantity:
    """One component of motion: of the adversaries, compared with their logs and with the traffic."""

    name: str
    percentiles: tuple[float, ...]  # of the adversaries after the attack, at PERCENTILES
    percentiles_before: tuple[float, ...]
    percentiles_traffic: tuple[float, ...]
    distance_before: float  # Wasserstein distance to the same agents before the attack, in the unit of the quantity
    distance_traffic: float  # to all background agents before the attack
    beyond_percent: float  # share of steps beyond the limit
    beyond_before_percent: float


@dataclass(frozen=True)
class Realism:
    """The realism of the adversaries in some attacks that ended in a collision."""

    adversaries: int
    quantities: tuple[Quantity, ...]
    off_road_percent: float  # share of steps with a corner more than 0.3 m off the road
    off_road_before_percent: float
    hits_others_percent: float  # share of adversaries that touched another road user before the ego


def motion(tracks: Tracks, agent: int, dt: float, end: int | None = None) -> MotionSamples:
    """The motion of one agent before step `end`."""
    valid, speed, yaw = (values[agent, :end] for values in (tracks.valid, tracks.speed, tracks.yaw))
    pairs = valid[:-1] & valid[1:]
    accel, yaw_rate = np.diff(speed) / dt, np.asarray(wrap(np.diff(yaw))) / dt
    lateral = 0.5 * (speed[:-1] + speed[1:]) * yaw_rate
    return MotionSamples(accel[pairs], lateral[pairs], (np.diff(accel) / dt)[pairs[:-1] & pairs[1:]], yaw_rate[pairs])


def pooled(motions: Sequence[MotionSamples]) -> MotionSamples:
    """All samples of several motions."""
    return MotionSamples(*(np.concatenate([getattr(one, f.name) for one in motions]) for f in fields(MotionSamples)))


def realism(attacked: Sequence[Scenario], limits: DryRoadLimits = DryRoadLimits()) -> Realism | None:
    """The realism of the adversaries in attacks with a collision, up to it; None where there is no such attack."""
    hits = [(case, case.attack.collision) for case in attacked if case.attack and case.attack.collision]
    if not hits:
        return None
    after, before, traffic, off, off_before, touching = [], [], [], [], [], 0
    for case, hit in hits:
        agent, end = next(i for i, a in enumerate(case.agents) if a.id == hit.agent), hit.step + 1
        log = case.before_attack()
        after.append(motion(case.tracks, agent, case.dt, end))
        before.append(motion(log.tracks, agent, case.dt, end))
        traffic += [motion(log.tracks, i, case.dt) for i in range(1, len(case.agents))]
        off.append(off_road_steps(case, agent, end))
        off_before.append(off_road_steps(log, agent, end))
        touching += Flaw.HITS_OTHERS in (flaws(case) or ())
    samples = pooled(after), pooled(before), pooled(traffic)
    return Realism(
        adversaries=len(hits),
        quantities=tuple(
            quantity(f.name, tuple(getattr(some, f.name) for some in samples), getattr(limits, f.name))
            for f in fields(MotionSamples)
        ),
        off_road_percent=_percent(np.concatenate(off)),
        off_road_before_percent=_percent(np.concatenate(off_before)),
        hits_others_percent=100.0 * touching / len(hits),
    )


def quantity(name: str, samples: tuple[Samples, Samples, Samples], limit: float) -> Quantity:
    """One component; `samples` are of the adversaries after the attack, before it, and of the traffic."""
    after, before, traffic = samples
    return Quantity(
        name,
        _cuts(after),
        _cuts(before),
        _cuts(traffic),
        distance_before=float(wasserstein_distance(after, before)),
        distance_traffic=float(wasserstein_distance(after, traffic)),
        beyond_percent=_percent(np.abs(after) > limit),
        beyond_before_percent=_percent(np.abs(before) > limit),
    )


def off_road_steps(scenario: Scenario, agent: int, end: int) -> Bool[np.ndarray, " step"]:
    """Whether a corner of the agent is more than 0.3 m off the road, at each valid step before `end`."""
    steps = np.flatnonzero(scenario.tracks.valid[agent, :end])
    shape = scenario.tracks.x.shape
    boxes = boxes_of(scenario.agents, scenario.tracks)
    box = Boxes(*(np.broadcast_to(values, shape)[agent, steps] for values in boxes))
    return np.any(corners_off_road(scenario.road, box), axis=-1)


def _cuts(values: Samples) -> tuple[float, ...]:
    return tuple(np.percentile(values, PERCENTILES).tolist())


def _percent(flags: Bool[np.ndarray, " _"]) -> float:
    return 100.0 * float(flags.mean()) if len(flags) else 0.0
