"""Numbers of the competent and careful driver, with their sources."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from regents_cosim.norms.limits import ACCEL_LIMIT, CURVATURE_LIMIT, steps_of


@dataclass(frozen=True)
class CarefulParameters:
    """The competent and careful human driver of UN Regulation 157.

    Source: UN R157, Annex 4, Appendix 3 (Annex 3 in the 01 series), performance models: a lane change is perceived
    0.375 m from the middle of the lane; 0.4 s to evaluate the risk; 0.75 s until the deceleration begins; 0.774 g,
    built up in 0.6 s (12.65 m/s^3); a cut-in is a danger below 2 s to collision, a leader once it brakes by more than
    5 m/s^2. The rest is ours: what it looks at on
    roads that are no motorway, that it dismisses a danger which it has not seen for as long as it takes to evaluate
    one, that it relies on its priority while others need no more than a comfortable deceleration to wait (3.4 m/s^2:
    AASHTO, A Policy on Geometric Design of Highways and Streets, 2018, 3.2.2), and swerves of half a car and a car,
    which the regulation's driver does not make, and the room that it keeps where it avoids a crash by more than a hair.
    """

    wandering_m: float = 0.375
    lead_braking_m_s2: float = 5.0
    evaluation_s: float = 0.4
    dismissal_s: float = 0.4
    comfortable_m_s2: float = 3.4
    delay_s: float = 0.75
    most_braking_m_s2: float = ACCEL_LIMIT
    jerk_m_s3: float = 12.65
    swerves_m: tuple[float, ...] = (0.9, -0.9, 1.8, -1.8)
    swerve_m_s2: float = 4.0
    room_m: float = 1.0

    @property
    def reaction_s(self) -> float:
        """The time [s] from the first sight of a danger until the brakes act."""
        return self.evaluation_s + self.delay_s

    @property
    def rise_s(self) -> float:
        """The time [s] in which the braking is built up."""
        return self.most_braking_m_s2 / self.jerk_m_s3


@dataclass(frozen=True)
class Foresight:
    """How far ahead the driver looks, and how it samples that time."""

    ahead_s: float = 4.0
    lead_s: float = 2.0  # for road users that run the ego's way and do not brake hard
    spacing_s: float = 0.25
    slack: int = 2  # spacings by which the ego may be earlier or later than expected
    over_s: float = 0.3  # past time over which turn and braking are measured
    along_rad: float = float(np.deg2rad(30.0))  # a road user whose heading differs by more crosses ...
    against_rad: float = float(np.deg2rad(150.0))  # ... and by more than this is oncoming

    @property
    def times_s(self) -> np.ndarray:
        """The times [s] from now at which the others are expected."""
        return self.spacing_s * np.arange(round(self.ahead_s / self.spacing_s) + 1)

    @property
    def ego_times_s(self) -> np.ndarray:
        """The times [s] from now at which the ego is expected, longer than `times_s` by the slack."""
        return self.spacing_s * np.arange(len(self.times_s) + self.slack)


CAREFUL = CarefulParameters()
FORESIGHT = Foresight()


# The time at which a careful driver acts on a danger that comes and goes.
# The driver believes a danger once it has lasted as long as its evaluation takes; some time after that the brakes
# act. The driver dismisses a danger that has not been seen for a while, before or after the brakes act. A driver who
# braked to a standstill for a danger that is over would escape a later crash by luck; so only the danger that leads
# to the crash counts, from when it was first seen. UN Regulation 157 says nothing of dangers that end; this driver
# dismisses one in the time that it takes to believe one.


def careful_perceives(xp: Any, risk: Any, dt: Any, at: Any = -1) -> Any:
    """The first step of the danger that the careful driver believes at a step; the number of steps if there is none.

    `xp` is NumPy or jax.numpy; `risk` [time] tells at which steps there is a danger; `dt` is the step length [s]. `at`
    is the step, normally the last one; nothing after it counts.
    """
    steps = risk.shape[0]
    now = xp.arange(steps)
    seen = xp.concatenate([xp.zeros(1, int), xp.cumsum(risk)])  # dangers before each step

    def within(last: Any) -> Any:
        return seen[now + 1] - seen[xp.maximum(now + 1 - last, 0)]

    lasting = steps_of(xp, CAREFUL.evaluation_s, dt)
    believed = within(lasting + 1) == lasting + 1
    dismissed = xp.cumsum(within(steps_of(xp, CAREFUL.dismissal_s, dt)) == 0)
    kept = believed & (dismissed == dismissed[at]) & (now <= now[at])
    return xp.where(kept.any(), xp.argmax(kept) - lasting, steps)


def careful_reaction_steps(xp: Any, dt: Any) -> Any:
    """Whole steps of `dt` [s] from the first one of a danger to the last one before the brakes act."""
    return xp.floor(CAREFUL.reaction_s / dt + _WHOLE).astype(int)


def seen_over_steps(xp: Any, dt: Any) -> Any:
    """Steps of `dt` [s] over which the driver measures turn and braking, at least 1."""
    return xp.maximum(steps_of(xp, FORESIGHT.over_s, dt), 1)


# How a driver brakes and swerves once it has decided to, for NumPy and JAX arrays alike: `xp` is the array module.
_WHOLE = 1e-3  # of a step: single precision makes slightly less of a whole number of steps
_TIGHTEST = 0.9 * CURVATURE_LIMIT  # [1/m] of a swerve: at low speed the wheels' angle is the limit


def braked_speed(xp: Any, own: Any, onset: Any, dt: Any) -> Any:
    """Speeds [m/s] over time: `own` [time] up to the step `onset`, then braking, never less than in `own`.

    `onset` is the last step before the brakes act (`careful_reaction_steps` after the danger was first seen), which
    they do once the reaction is over, between two steps of `dt` [s] if need be.
    """
    now = xp.arange(own.shape[0])
    lost = -xp.diff(own, prepend=own[:1])
    late_s = CAREFUL.reaction_s - careful_reaction_steps(xp, dt) * dt
    braked = xp.diff(_braked_away(xp, (now - onset) * dt - late_s), prepend=0.0)
    after = own[onset] - xp.cumsum(xp.where(now > onset, xp.maximum(braked, lost), 0.0))
    return xp.where(now <= onset, own, xp.maximum(after, 0.0))


def _braked_away(xp: Any, seconds: Any) -> Any:
    """Speed [m/s] that the brakes have taken away so many `seconds` after they began to act."""
    rising_s = xp.clip(seconds, 0.0, CAREFUL.rise_s)
    in_full_s = xp.maximum(seconds - CAREFUL.rise_s, 0.0)
    return 0.5 * CAREFUL.jerk_m_s3 * rising_s**2 + CAREFUL.most_braking_m_s2 * in_full_s


def swerve_length(xp: Any, speed: Any, shift_m: Any) -> Any:
    """Distance [m] in which a swerve at `speed` [m/s] moves aside by `shift_m`."""
    sharpest = 2.0 * np.pi * xp.abs(shift_m)
    return xp.maximum(speed * xp.sqrt(sharpest / CAREFUL.swerve_m_s2), xp.sqrt(sharpest / _TIGHTEST))


def swerve(xp: Any, distance: Any, length: Any, shift_m: Any) -> tuple[Any, Any]:
    """Lateral offset [m] and heading [rad] after `distance` [m] of a swerve of sinusoidal lateral acceleration."""
    length = xp.maximum(length, 1e-3)
    done = xp.clip(distance / length, 0.0, 1.0)
    aside = shift_m * (done - xp.sin(2.0 * np.pi * done) / (2.0 * np.pi))
    return aside, xp.arctan(shift_m / length * (1.0 - xp.cos(2.0 * np.pi * done)))
