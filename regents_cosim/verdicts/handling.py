"""Measure how a drive feels: speed, longitudinal and lateral acceleration, and jerk, each a mean over a second.

Positions of recordings are noisy: over 0.3 s their jerk is only noise, so the mean is over a whole second. ISO 15622
measures the jerk of cruise controls over a second as well.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from regents_cosim.geometry.lines import way_at
from regents_cosim.norms.limits import steps_of
from regents_cosim.scenario.scenario import Tracks

MEAN_S = 1.0  # over which motion is taken


@dataclass(frozen=True, eq=False)
class Handling:
    """One road user over a time without a gap."""

    speed: Float[np.ndarray, " time"]  # [m/s] at the begin of the second
    accel: Float[np.ndarray, " time"]  # [m/s^2] negative: braking
    aside: Float[np.ndarray, " time"]  # [m/s^2] to either side
    jerk: Float[np.ndarray, " time"]  # [m/s^3] from one second to the next


def mean_steps(xp: Any, dt: Any) -> Any:
    """Steps of `dt` [s] over which motion is taken, at least 1."""
    return xp.maximum(steps_of(xp, MEAN_S, dt), 1)


def handling(tracks: Tracks, agent: int, dt: float, end: int) -> list[Handling]:
    """The handling of an agent before step `end`, for each time of more than two seconds without a gap."""
    valid = np.concatenate([[False], tracks.valid[agent, :end], [False]])
    borders = np.flatnonzero(np.diff(valid.astype(int)))
    steps = int(mean_steps(np, dt))
    pieces = (slice(begin, stop) for begin, stop in borders.reshape(-1, 2) if stop - begin > 2 * steps)
    return [felt(tracks.speed[agent, piece], tracks.yaw[agent, piece], steps, dt) for piece in pieces]


def felt(speed: Float[np.ndarray, " step"], yaw: Float[np.ndarray, " step"], steps: int, dt: float) -> Handling:
    """The handling of a drive, each value a mean over `steps` steps; it has more than twice as many."""
    begins = np.arange(len(speed) - 2 * steps)
    along, aside, jerk = felt_from(np, begins, speed, np.unwrap(yaw), steps, dt)
    return Handling(speed[: len(jerk)], along, np.abs(aside), jerk)


def felt_from(xp: Any, begins: Any, speed: Any, yaw: Any, steps: Any, dt: Any) -> tuple[Any, Any, Any]:
    """The accelerations along and to the left [m/s^2] and the jerk [m/s^3] from each of the steps `begins` on.

    Each is a mean over `steps` steps of `dt` [s]. `speed` [m/s] and `yaw` [rad, without jumps] are those of the last
    axis; `begins` leaves twice as many steps.
    """
    lasts_s, way = steps * dt, way_at(speed, 1.0, xp)
    here, then = begins, begins + steps
    along, next_along = ((speed[..., at + steps] - speed[..., at]) / lasts_s for at in (here, then))
    aside = (way[..., then] - way[..., here]) / steps * (yaw[..., then] - yaw[..., here]) / lasts_s
    return along, aside, (next_along - along) / lasts_s
