"""Computes speeds from observed positions."""

import numpy as np
from jaxtyping import Bool, Float

from regents_cosim.geometry.frames import wrap
from regents_cosim.geometry.jumps import jumps


def speeds(
    x: Float[np.ndarray, "agent time"],
    y: Float[np.ndarray, "agent time"],
    yaw: Float[np.ndarray, "agent time"],
    valid: Bool[np.ndarray, "agent time"],
    dt: float,
) -> Float[np.ndarray, "agent time"]:
    """Speed of the box centre along its heading [m/s], never negative, 0 where invalid.

    Each displacement is projected on the heading midway. With the distance s driven so far, v[k] = (s[k+1] - s[k-1]) /
    (2 dt), and at the ends, also of second order, (-3 s[k] + 4 s[k+1] - s[k+2]) / (2 dt). So speed and positions agree,
    and a bicycle model can follow both; the speed that SUMO reports belongs to the next step and to the front bumper. A
    jump is not a motion: a step with a jump is ignored where a neighbouring step gives the speed.
    """
    links = valid[:, :-1] & valid[:, 1:]
    middle = yaw[:, :-1] + 0.5 * wrap(np.diff(yaw))
    rates = (np.diff(x) * np.cos(middle) + np.diff(y) * np.sin(middle)) / dt
    driven = _of_rates(np.where(links & ~jumps(x, y, links, dt), rates, np.nan))
    found = np.where(np.isnan(driven), _of_rates(np.where(links, rates, np.nan)), driven)
    return np.where(valid & ~np.isnan(found), np.maximum(found, 0.0), 0.0)


def _of_rates(rates: Float[np.ndarray, "agent step"]) -> Float[np.ndarray, "agent step+1"]:
    """Speed [m/s] at every instant from the mean speeds between instants; NaN where those are NaN."""
    border = np.full((len(rates), 2), np.nan)
    padded = np.hstack([border, rates, border])
    before2, before, after, after2 = padded[:, :-3], padded[:, 1:-2], padded[:, 2:-1], padded[:, 3:]
    found = 0.5 * (before + after)
    for near, far in ((after, after2), (before, before2)):
        for estimate in (1.5 * near - 0.5 * far, near):
            found = np.where(np.isnan(found), estimate, found)
    return found
