"""How fast a candidate may drive along a line: it goes on as it does, then brakes or speeds up to another speed.

Bends slow it down. All profiles of a line are driven together.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from regents_cosim.attacks.drive_lines import PULLING_OUT_M_S, SPACING_M, DriveLine
from regents_cosim.limits import OVER_LIMIT

_BEND_ACCEL = 3.0  # [m/s^2] sideways, that a driver takes in a bend (Treiber and Kesting 2013: 2 to 3 in cities)
_BEND_BRAKE = 2.0  # [m/s^2] with which it slows down for one
_HARDEST_BRAKE = 4.5  # [m/s^2] of all profiles; emergencies are left to the descent
_BRAKES = (-4.0, -2.5, -1.5, -0.75)  # [m/s^2]
_SLOWER = (0.0, 0.25, 0.5, 0.75)  # shares of the speed at first that braking ends at
_GAINS = (0.75, 1.5, 2.5)  # [m/s^2]
_FASTER_M_S = (1.0, 2.0, 4.0, 6.0, 9.0, 13.0)
_BEGINS_S = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)  # until then it goes on, or waits


@dataclass(frozen=True, eq=False)
class Profiles:
    """Speeds that are wanted along some lines, one row each."""

    line: Int[np.ndarray, " profile"]  # which of the lines
    accel: Float[np.ndarray, " profile"]  # [m/s^2]
    wanted: Float[np.ndarray, " profile"]  # [m/s] at which it ends
    begins_s: Float[np.ndarray, " profile"]


def profiles(lines: Sequence[DriveLine], speed: float, fastest_logged: float) -> Profiles:
    """Those that one with that speed [m/s] has on the lines; at most 1.2 times the limit, or as fast as in its log."""
    rows = [
        (index, *change)
        for index, line in enumerate(lines)
        for change in _changes(speed, _most(line.limit, fastest_logged))
    ]
    line, accel, wanted, begins_s = np.array(rows).T
    return Profiles(line.astype(int), accel, wanted, begins_s)


def _changes(speed: float, most: float) -> Iterator[tuple[float, float, float]]:
    """Accelerations [m/s^2], the speeds [m/s] at which they end, and when they begin [s]."""
    slower = [(brake, share * max(speed, PULLING_OUT_M_S)) for brake in _BRAKES for share in _SLOWER]
    faster = [(gain, speed + more) for gain in _GAINS for more in _FASTER_M_S]
    yield 0.0, speed, 0.0
    for begins_s in _BEGINS_S:
        yield from ((accel, wanted, begins_s) for accel, wanted in slower if wanted < speed)
        yield from ((accel, wanted, begins_s) for accel, wanted in faster if wanted <= most)


def _most(limit: float, logged: float) -> float:
    return max(OVER_LIMIT * limit, logged) if np.isfinite(limit) else 1.3 * max(logged, PULLING_OUT_M_S)


def drive(
    lines: Sequence[DriveLine], speed: float, wanted: Profiles, steps: int, dt: float
) -> tuple[Float[np.ndarray, "profile time"], Float[np.ndarray, "profile time"]]:
    """Speeds [m/s] and distances [m] of the profiles along their lines, slower than wanted where those bend."""
    allowed = np.concatenate([_allowed_in_bends(line) for line in lines])
    ends = np.cumsum([len(line.points) for line in lines])
    begins, last = (ends - [len(line.points) for line in lines])[wanted.line] + 1, ends[wanted.line] - 1
    driven = np.empty((steps, len(wanted.accel)))
    travelled = np.zeros_like(driven)
    driven[0] = speed
    for step in range(1, steps):
        now = driven[step - 1]
        ahead = np.minimum(begins + (travelled[step - 1] / SPACING_M).astype(int), last)
        aim = np.minimum(_aim(now, speed, wanted, (step - 1) * dt, dt), allowed[ahead])
        aim = np.clip(aim, now - _HARDEST_BRAKE * dt, now + _GAINS[-1] * dt)
        driven[step] = np.maximum(aim, 0.0)
        travelled[step] = travelled[step - 1] + 0.5 * (now + driven[step]) * dt
    return driven.T, travelled.T


def _aim(now: np.ndarray, begun: float, wanted: Profiles, time_s: float, dt: float) -> np.ndarray:
    """The next speeds [m/s], if no bend is in the way."""
    after = now + wanted.accel * dt
    slower = np.maximum(after, np.minimum(wanted.wanted, now))
    faster = np.maximum(np.minimum(after, wanted.wanted), np.minimum(now, wanted.wanted))
    changed = np.where(wanted.accel < 0.0, slower, np.where(wanted.accel > 0.0, faster, begun))
    return np.where(time_s >= wanted.begins_s, changed, begun)


def _allowed_in_bends(line: DriveLine) -> Float[np.ndarray, " point"]:
    """Speed [m/s] at every point that its bend allows, and those ahead within gentle braking."""
    curvature = np.abs(np.gradient(line.heading)) / SPACING_M
    gained = 2.0 * _BEND_BRAKE * SPACING_M * np.arange(len(curvature))
    square = _BEND_ACCEL / np.maximum(curvature, 1e-4) + gained
    return np.sqrt(np.minimum.accumulate(square[::-1])[::-1] - gained)
