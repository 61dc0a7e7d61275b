"""When a driver can see that another departs from its log."""

import numpy as np
import pytest
from avoidable_scenes import moved
from scenes import DT, crash, scene, straight_road

from regents_cosim.verdicts.behaviour import departs_step


@pytest.mark.parametrize(
    ("change", "step"),
    [
        ({"y": lambda t: 0.3 * t}, 13),  # 0.5 m off at 1.67 s; 0.375 m from the middle of its lane at 1.25 s
        ({"x": lambda t: 30 + 15 * t - 3 * t**2, "speed": lambda t: 15 - 6 * t}, 3),
        ({}, None),
    ],
)
def test_a_departure_is_seen_by_place_speed_or_lane(change, step):
    made = scene((0, 0, 25), (30, 0, 15), road=straight_road(1))
    time = np.minimum(DT * np.arange(81), 2.5)
    tracks = moved(made, 1, **{name: values(time) for name, values in change.items()})
    assert departs_step(crash(made, tracks), 1) == step
