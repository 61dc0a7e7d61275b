"""Traffic, and a drive in it that may be unusual."""

import numpy as np
from scenes import DT, scene
from two_car_scenes import moving

from regents_cosim.scenario.scenario import Scenario

STEPS = 81


def traffic(cars: int = 12, seed: int = 0) -> Scenario:
    """Cars in a row whose speeds wander, each by itself and all by the same law."""
    rng = np.random.default_rng(seed)
    made = scene(*((40.0 * i, 0.0, 12.0) for i in range(cars)), steps=STEPS)
    for car in range(cars):
        made = driven(made, car, np.cumsum(rng.normal(0.0, 0.35, STEPS - 1)).clip(-3.0, 2.0))
    return made


def driven(made: Scenario, car: int, accel: np.ndarray) -> Scenario:
    """The scenario with other accelerations of one car [m/s^2]."""
    start = made.tracks
    speed = np.maximum(start.speed[car, 0] + DT * np.concatenate([[0.0], np.cumsum(accel)]), 0.0)
    gone = DT * np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))])
    return moving(made, car, x=start.x[car, 0] + gone, speed=speed)
