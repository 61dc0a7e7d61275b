"""A crash that a driver could have avoided: a lead that brakes."""

import numpy as np
from scenes import DT, crash, moved, scene, straight_road

ONE_LANE = straight_road(1)


def braking_lead(gap, *others, road=ONE_LANE):
    """The ego at 15 m/s, `gap` m behind a car that brakes at 6 m/s^2 to a stop, which takes 18.75 m."""
    made = scene((0, 0, 15), (gap + 4.6, 0, 15), *others, road=road)
    time = np.minimum(DT * np.arange(81), 2.5)
    return crash(made, moved(made, 1, x=gap + 4.6 + 15 * time - 3 * time**2, speed=15 - 6 * time))
