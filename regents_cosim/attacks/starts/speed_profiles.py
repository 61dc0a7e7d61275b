"""Speed profiles of a candidate along a line: it continues as it does, then brakes or accelerates to another speed.

Bends slow it down, and accelerations build up with the jerk of ordinary drivers. All profiles are computed together.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from regents_cosim.attacks.starts.drive_lines import PULLING_OUT_M_S, SPACING_M, DriveLine
from regents_cosim.norms.limits import OVER_LIMIT
from regents_cosim.verdicts.handling import MEAN_S, mean_steps
from regents_cosim.verdicts.ordinary import DrivingLimits

_BEND_BRAKE = 2.0  # [m/s^2] braking before a bend
_BRAKES = (1.0, 0.6, 0.4, 0.2)  # shares of the hardest braking
_SLOWER = (0.0, 0.25, 0.5, 0.75)  # shares of the initial speed at which braking ends
_GAINS = (0.3, 0.6, 1.0)  # shares of the greatest acceleration


@dataclass(frozen=True)
class Paces:
    """The changes of speed that are tried."""

    usual_m_s: float  # slower agents brake to shares of this
    faster_m_s: tuple[float, ...]
    begins_s: tuple[float, ...]  # times at which the change begins


DRIVING = Paces(PULLING_OUT_M_S, (1.0, 2.0, 4.0, 6.0, 9.0, 13.0), (0.0, 1.0, 2.0, 3.0, 4.0, 5.0))
# For pedestrians half a second decides whether the front hits or passes.
WALKING = Paces(1.2, (0.3, 0.6, 1.0, 1.5, 2.1), tuple(0.5 * k for k in range(11)))


@dataclass(frozen=True, eq=False)
class Profiles:
    """Wanted speeds along some lines, one profile per row."""

    line: Int[np.ndarray, " profile"]  # index of the line
    accel: Float[np.ndarray, " profile"]  # [m/s^2]
    wanted: Float[np.ndarray, " profile"]  # [m/s] at which the change ends
    begins_s: Float[np.ndarray, " profile"]


def profiles(
    lines: Sequence[DriveLine], speed: float, fastest_logged: float, limits: DrivingLimits, paces: Paces
) -> Profiles:
    """The profiles of an agent with `speed` [m/s] on the lines, up to 1.2 times the limit, or the speed of its log."""
    changes: dict[float, np.ndarray] = {}  # most lines share one limit
    for most in (fastest := [fastest_wanted(line.limit, fastest_logged) for line in lines]):
        if most not in changes:
            changes[most] = np.array([*_changes(speed, most, limits, paces)])
    mine = [changes[most] for most in fastest]
    return Profiles(np.repeat(np.arange(len(lines)), [len(one) for one in mine]), *np.concatenate(mine).T)


def _changes(speed: float, most: float, limits: DrivingLimits, paces: Paces) -> Iterator[tuple[float, float, float]]:
    """Accelerations [m/s^2], the speeds [m/s] at which they end, and the times [s] at which they begin."""
    slower = [(-b * limits.braking, share * max(speed, paces.usual_m_s)) for b in _BRAKES for share in _SLOWER]
    faster = [(gain * limits.accel, speed + more) for gain in _GAINS for more in paces.faster_m_s]
    yield 0.0, speed, 0.0
    for begins_s in paces.begins_s:
        yield from ((accel, wanted, begins_s) for accel, wanted in slower if wanted < speed)
        yield from ((accel, wanted, begins_s) for accel, wanted in faster if wanted <= most)


def fastest_wanted(limit: float, logged: float) -> float:
    """The top speed [m/s] under a speed limit; without one it follows from the speed of the log."""
    return max(OVER_LIMIT * limit, logged) if np.isfinite(limit) else 1.3 * max(logged, PULLING_OUT_M_S)


def drive(
    lines: Sequence[DriveLine],
    begun: tuple[float, float],
    wanted: Profiles,
    steps: int,
    dt: float,
    limits: DrivingLimits,
) -> tuple[Float[np.ndarray, "profile time"], Float[np.ndarray, "profile time"]]:
    """Speeds [m/s] and distances [m] of the profiles along their lines, slower than wanted in bends.

    All begin with one speed and acceleration `begun` [m/s, m/s^2]; over any second the acceleration changes by no more
    than the jerk of the `limits`.
    """
    allowed = np.concatenate([_allowed_in_bends(line, limits.lateral_accel) for line in lines])
    ends = np.cumsum([len(line.points) for line in lines])
    begins, last = (ends - [len(line.points) for line in lines])[wanted.line] + 1, ends[wanted.line] - 1
    at_once, over_a_second = limits.jerk_at_once * dt, limits.jerk * MEAN_S
    driven = np.empty((steps, len(wanted.accel)))
    travelled = np.zeros_like(driven)
    driven[0], accel = begun[0], np.full(len(wanted.accel), begun[1])
    recent = np.full((int(mean_steps(np, dt)), len(accel)), begun[1])  # accelerations of the last second
    asked = _Asked.at(0.0, wanted, begun[0])
    builds_up_s = _BEND_BRAKE / (limits.jerk_at_once if over_a_second >= _BEND_BRAKE else limits.jerk)
    for step in range(1, steps):
        now, at = driven[step - 1], travelled[step - 1]
        there, ahead = (
            allowed[np.minimum(begins + ((at + further) / SPACING_M).astype(int), last)]
            for further in (0.0, now * builds_up_s)  # when it brakes as before a bend
        )
        time_s = (step - 1) * dt
        if time_s >= asked.until_s:
            asked = _Asked.at(time_s, wanted, begun[0])
        aim = asked.aim(now, np.minimum(there, ahead), limits)
        least = np.maximum(accel - at_once, recent.max(axis=0) - over_a_second)
        most = np.minimum(accel + at_once, recent.min(axis=0) + over_a_second)
        accel = np.minimum(np.maximum(_landing(*aim, limits, dt), least), most)  # `clip` takes twice as long
        driven[step] = np.maximum(now + accel * dt, 0.0)
        accel = np.where(driven[step] > 0.0, accel, 0.0)
        recent[step % len(recent)] = accel
        travelled[step] = at + 0.5 * (now + driven[step]) * dt
    return driven.T, travelled.T


class _Asked(NamedTuple):
    """The wanted speeds until the next profile begins to change its speed."""

    until_s: float  # when that profile begins
    speed: Float[np.ndarray, " profile"]  # [m/s]
    slows: Bool[np.ndarray, " profile"]  # only slows down to it, never accelerates to it
    accel: Float[np.ndarray, " profile"]  # [m/s^2] greatest magnitude

    @classmethod
    def at(cls, time_s: float, wanted: Profiles, begun: float) -> "_Asked":
        """The wanted speeds at `time_s` [s], for profiles that began at `begun` [m/s]."""
        changing = (wanted.accel != 0.0) & (time_s >= wanted.begins_s)
        speed = np.where(changing, wanted.wanted, begun)
        until_s = float(wanted.begins_s.min(initial=np.inf, where=wanted.begins_s > time_s))
        return cls(until_s, speed, changing & (wanted.accel < 0.0), np.where(changing, np.abs(wanted.accel), np.inf))

    def aim(self, now: np.ndarray, allowed: np.ndarray, limits: DrivingLimits) -> tuple[np.ndarray, np.ndarray]:
        """The desired changes of the speeds `now` [m/s], and the greatest magnitudes of acceleration [m/s^2] for them.

        No target exceeds the speed that is `allowed` in bends.
        """
        # An agent that a bend has slowed down does not accelerate in order to brake less.
        target = np.where(self.slows, np.minimum(self.speed, now), self.speed)
        in_bend = allowed < np.minimum(target, now)
        target = np.minimum(target, allowed)
        hardest = np.where(target < now, limits.braking, limits.accel)
        return target - now, np.where(in_bend, hardest, np.minimum(self.accel, hardest))


def _landing(change: np.ndarray, most: np.ndarray, limits: DrivingLimits, dt: float) -> np.ndarray:
    """The greatest accelerations [m/s^2] from which the new speed is still reached while easing off."""
    size = np.abs(change)
    slow, fast = (np.sqrt(2.0 * jerk * size + 0.25 * (jerk * dt) ** 2) - 0.5 * jerk * dt
                  for jerk in (limits.jerk, limits.jerk_at_once))  # fmt: skip
    eased = np.minimum(fast, np.maximum(limits.jerk * MEAN_S, slow))
    return np.copysign(np.minimum(np.minimum(most, eased), size / dt), change)


def _allowed_in_bends(line: DriveLine, lateral_accel: float) -> Float[np.ndarray, " point"]:
    """The speed [m/s] at every point that its bend allows, and bends ahead within gentle braking."""
    curvature = np.abs(np.gradient(line.heading)) / SPACING_M
    gained = 2.0 * _BEND_BRAKE * SPACING_M * np.arange(len(curvature))
    square = lateral_accel / np.maximum(curvature, 1e-4) + gained
    return np.sqrt(np.minimum.accumulate(square[::-1])[::-1] - gained)
