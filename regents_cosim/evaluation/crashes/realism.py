"""Measures whether an adversary still moves like the traffic that it comes from.

Motion is computed by finite differences of speed and yaw between valid steps, in the same way for logged and attacked
tracks: acceleration and yaw rate belong to the middle of a step, jerk to the instant between two steps.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float
from scipy.stats import wasserstein_distance

from regents_cosim.geometry.frames import wrap
from regents_cosim.geometry.lines import midway
from regents_cosim.scenario.scenario import Scenario, Tracks


@dataclass(frozen=True, eq=False)
class MotionSamples:
    """Samples of the motion of some agents, from all their valid steps."""

    accel: Float[np.ndarray, " sample"]  # [m/s^2] along the heading
    lateral: Float[np.ndarray, " sample"]  # [m/s^2] speed times yaw rate
    jerk: Float[np.ndarray, " instant"]  # [m/s^3] along the heading
    yaw_rate: Float[np.ndarray, " sample"]  # [rad/s]


def motion(tracks: Tracks, agent: int, dt: float, end: int | None = None) -> MotionSamples:
    """The motion of one agent before step `end`."""
    valid, speed, yaw = (values[agent, :end] for values in (tracks.valid, tracks.speed, tracks.yaw))
    pairs = valid[:-1] & valid[1:]
    accel, yaw_rate = np.diff(speed) / dt, np.asarray(wrap(np.diff(yaw))) / dt
    lateral = midway(speed) * yaw_rate
    return MotionSamples(accel[pairs], lateral[pairs], (np.diff(accel) / dt)[pairs[:-1] & pairs[1:]], yaw_rate[pairs])


def pooled(motions: Sequence[MotionSamples]) -> MotionSamples:
    """All samples of several motions."""
    return MotionSamples(*(np.concatenate([getattr(one, f.name) for one in motions]) for f in fields(MotionSamples)))


def distances_to_traffic(attacked: Sequence[Scenario]) -> dict[str, float]:
    """Wasserstein distance of each component between adversaries, up to their collisions, and all background traffic.

    In the unit of the component; empty where no attack ends in a collision.
    """
    after, traffic = [], []
    for case in attacked:
        if (hit := case.collision) is not None:
            agent, log = case.index(hit.agent), case.recorded_tracks
            after.append(motion(case.tracks, agent, case.dt, hit.step + 1))
            traffic += [motion(log, i, case.dt) for i in range(1, len(case.agents))]
    if not after:
        return {}
    ours, theirs = pooled(after), pooled(traffic)
    return {f.name: float(wasserstein_distance(getattr(ours, f.name), getattr(theirs, f.name))) for f in fields(ours)}
