"""highway-env's vehicle model read backwards: from motions to the controls behind them."""

import numpy as np
from jaxtyping import Complex, Float

from regents_cosim.geometry.frames import wrap

EXACT_M = 1e-3  # a motion that the model misses by more comes from another one
_MIN_TRAVEL_M = 1e-6


def controls_behind(
    x: Float[np.ndarray, "agent time"],
    y: Float[np.ndarray, "agent time"],
    yaw: Float[np.ndarray, "agent time"],
    speed: Float[np.ndarray, "agent time"],
    length: Float[np.ndarray, " agent"],
    dt: float,
) -> tuple[Float[np.ndarray, "2 agent step"], Complex[np.ndarray, "agent step"]]:
    """Accelerations [m/s^2] and curvatures [1/m] over each step of `dt` [s], and by how much the model then misses.

    The model goes on by the speed at the begin of the step, along the yaw plus the slip angle, which the wheel sets at
    once (`wheel_from_curvature`). What it misses is x + iy [m] in the map's frame, infinite where no wheel turns so.
    """
    travelled = speed[:, :-1] * dt
    turned = np.asarray(wrap(np.diff(yaw)))
    curvature = np.where(travelled > _MIN_TRAVEL_M, turned / np.maximum(travelled, _MIN_TRAVEL_M), 0.0)
    sine = 0.5 * length[:, None] * curvature
    course = yaw[:, :-1] + np.arcsin(np.clip(sine, -1.0, 1.0))
    missed = travelled * np.exp(1j * course) - np.diff(x + 1j * y)
    return np.stack([np.diff(speed) / dt, curvature]), np.where(np.abs(sine) > 1.0, np.inf, missed)
