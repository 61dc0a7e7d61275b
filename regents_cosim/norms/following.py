"""How drivers follow a leader, and whether they can stop in time.

Sources: Treiber, Hennecke and Helbing 2000 (the Intelligent Driver Model's gap); Hayward 1972 (time to collision).
`xp` is NumPy or jax.numpy; all other arguments are numbers or arrays.
"""

from typing import Any

import numpy as np

LEAST_GAP_M = 0.1  # smaller gaps count as this, as the interaction would blow up


def desired_gap(xp: Any, speed: Any, closing: Any, headway_s: Any, standstill_m: Any, accel: Any, braking: Any) -> Any:
    """The gap s* [m] to a leader: s0 + max(0, v T + v dv / (2 sqrt(a b))), with the speed v and the `closing` dv [m/s].

    T and s0 are headway and gap at standstill, a and b acceleration and comfortable braking [m/s^2].
    """
    return standstill_m + xp.maximum(speed * headway_s + speed * closing / (2.0 * (accel * braking) ** 0.5), 0.0)


def braking_needed(xp: Any, gap: Any, closing: Any) -> Any:
    """The deceleration [m/s^2] that ends the closing [m/s] within the gap [m]."""
    return xp.maximum(closing, 0.0) ** 2 / (2.0 * xp.maximum(gap, LEAST_GAP_M))


def time_to_collision(gap: Any, closing: Any) -> Any:
    """Seconds until a follower touches its leader if both keep their speeds: gap / closing speed; NaN if never."""
    return np.divide(gap, closing, out=np.full(np.shape(gap), np.nan), where=closing > 0.0)


def can_stop(speed: Any, within_m: Any, braking: Any) -> Any:
    """Whether vehicles at a speed [m/s] can stop within a distance [m] ahead by `braking` [m/s^2]."""
    return (within_m > 0.0) & (speed**2 <= 2.0 * braking * within_m)
