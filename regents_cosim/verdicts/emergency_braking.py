"""How a driver brakes along the ego's own path, once it has decided to, and swerves meanwhile."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from regents_cosim.mirror.bicycle import CURVATURE_LIMIT
from regents_cosim.scenario import Scenario
from regents_cosim.verdicts.ego_path import EgoPath


@dataclass(frozen=True)
class Brakes:
    """How hard, and how soon as hard as that."""

    most: float  # [m/s^2]
    jerk: float  # [m/s^3]


@dataclass(frozen=True, eq=False)
class EgoPlaces:
    """The ego's places at every step, those beyond the horizon included."""

    x: Float[np.ndarray, " time"]  # [m]
    y: Float[np.ndarray, " time"]  # [m]
    yaw: Float[np.ndarray, " time"]  # [rad]
    speed: Float[np.ndarray, " time"]  # [m/s]


def braked_speed(
    own: Float[np.ndarray, " time"], onset: int, brakes: Brakes, dt: float, steps: int
) -> Float[np.ndarray, " step"]:
    """Speeds [m/s] at `steps` instants: the `own` up to the onset, then braking, never less than by one's own."""
    since = dt * np.arange(1, steps - onset)
    own_braking = np.zeros(len(since))
    known = -np.diff(own[onset:steps]) / dt
    own_braking[: len(known)] = known
    braking = np.maximum(np.minimum(brakes.jerk * (since - 0.5 * dt), brakes.most), own_braking)
    after = np.maximum(own[onset] - dt * np.cumsum(braking), 0.0)
    return np.concatenate([own[: onset + 1], after])


def driven(
    scenario: Scenario, path: EgoPath, speed: Float[np.ndarray, " step"], onset: int, shift_m: float, lateral: float
) -> EgoPlaces:
    """The drive with these speeds, which moves aside by `shift_m` from the onset on with `lateral` m/s^2 at most."""
    after = 0.5 * (speed[onset:-1] + speed[onset + 1 :]) * scenario.dt
    beyond = np.concatenate([[0.0], np.cumsum(after)])
    distance = np.concatenate([path.driven[:onset], path.driven[onset] + beyond])
    x, y, yaw = path.at(distance)
    if shift_m:
        aside, turn = _aside(np.maximum(distance - path.driven[onset], 0.0), float(speed[onset]), shift_m, lateral)
        x, y, yaw = x - aside * np.sin(yaw), y + aside * np.cos(yaw), yaw + turn
    return EgoPlaces(x, y, yaw, speed)


def _aside(
    distance: Float[np.ndarray, " step"], speed: float, shift_m: float, lateral: float
) -> tuple[Float[np.ndarray, " step"], Float[np.ndarray, " step"]]:
    """The lane change of sinusoidal lateral acceleration (`manoeuvres`): metres aside and turn [rad]."""
    sharpest = 2.0 * np.pi * abs(shift_m)
    length = max(speed * np.sqrt(sharpest / lateral), np.sqrt(sharpest / (0.9 * CURVATURE_LIMIT)))
    done = np.minimum(distance / length, 1.0)
    aside = shift_m * (done - np.sin(2.0 * np.pi * done) / (2.0 * np.pi))
    return aside, np.arctan(shift_m / length * (1.0 - np.cos(2.0 * np.pi * done)))
