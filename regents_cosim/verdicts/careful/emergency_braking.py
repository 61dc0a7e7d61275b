"""The drive of an ego that slows down along its own path, and swerves meanwhile."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from regents_cosim.norms.evasion import swerve, swerve_length
from regents_cosim.scenario import Scenario
from regents_cosim.verdicts.careful.ego_path import EgoPath


@dataclass(frozen=True, eq=False)
class EgoPositions:
    """Positions of the ego at every step, also beyond the horizon."""

    x: Float[np.ndarray, " time"]  # [m]
    y: Float[np.ndarray, " time"]  # [m]
    yaw: Float[np.ndarray, " time"]  # [rad]
    speed: Float[np.ndarray, " time"]  # [m/s]


def braking_positions(
    scenario: Scenario, path: EgoPath, speed: Float[np.ndarray, " step"], onset: int, shift_m: float, lateral: float
) -> EgoPositions:
    """The drive with these speeds that moves aside by `shift_m` from the onset on, with at most `lateral` m/s^2."""
    after = 0.5 * (speed[onset:-1] + speed[onset + 1 :]) * scenario.dt
    beyond = np.concatenate([[0.0], np.cumsum(after)])
    distance = np.concatenate([path.driven[:onset], path.driven[onset] + beyond])
    x, y, yaw = path.at(distance)
    if shift_m:
        length = swerve_length(np, speed[onset], shift_m, lateral)
        aside, turn = swerve(np, distance - path.driven[onset], length, shift_m)
        x, y, yaw = x - aside * np.sin(yaw), y + aside * np.cos(yaw), yaw + turn
    return EgoPositions(x, y, yaw, speed)
