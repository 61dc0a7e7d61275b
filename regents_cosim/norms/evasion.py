"""How a driver brakes and swerves once it has decided to, for NumPy and JAX arrays alike: `xp` is the array module."""

from typing import Any

import numpy as np

from regents_cosim.norms.limits import CURVATURE_LIMIT

_TIGHTEST = 0.9 * CURVATURE_LIMIT  # [1/m] of a swerve: at low speed the wheels' angle is the limit


def braked_speed(xp: Any, own: Any, onset: Any, most: float, jerk: float, dt: Any) -> Any:
    """Speeds [m/s] over time: `own` [time] up to the step `onset`, then braking, never less than in `own`.

    The brakes reach `most` [m/s^2] with `jerk` [m/s^3]; `dt` is the step length [s].
    """
    now = xp.arange(own.shape[0])
    lost = -xp.diff(own, prepend=own[:1])
    ramp = xp.clip(jerk * ((now - onset) * dt - 0.5 * dt), 0.0, most) * dt
    after = own[onset] - xp.cumsum(xp.where(now > onset, xp.maximum(ramp, lost), 0.0))
    return xp.where(now <= onset, own, xp.maximum(after, 0.0))


def swerve_length(xp: Any, speed: Any, shift_m: Any, lateral_m_s2: Any) -> Any:
    """Distance [m] in which a swerve at `speed` [m/s] moves aside by `shift_m`, with `lateral_m_s2` at its peak."""
    sharpest = 2.0 * np.pi * xp.abs(shift_m)
    return xp.maximum(speed * xp.sqrt(sharpest / lateral_m_s2), xp.sqrt(sharpest / _TIGHTEST))


def swerve(xp: Any, distance: Any, length: Any, shift_m: Any) -> tuple[Any, Any]:
    """Lateral offset [m] and heading [rad] after `distance` [m] of a swerve of sinusoidal lateral acceleration."""
    length = xp.maximum(length, 1e-3)
    done = xp.clip(distance / length, 0.0, 1.0)
    aside = shift_m * (done - xp.sin(2.0 * np.pi * done) / (2.0 * np.pi))
    return aside, xp.arctan(shift_m / length * (1.0 - xp.cos(2.0 * np.pi * done)))
