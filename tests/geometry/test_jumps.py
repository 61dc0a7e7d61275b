import numpy as np
import pytest

from regents_cosim.geometry.jumps import jumps, leaps

DT = 0.1
TIME = DT * np.arange(40)
BRAKING = 20.0 * np.minimum(TIME, 2.0) - 4.5 * np.maximum(np.minimum(TIME, 2.0) - 1.0, 0.0) ** 2
ALL = np.ones((1, 40), bool)


def leap(x, y=None, valid=ALL):
    return bool(leaps(x[None], np.zeros((1, 40)) if y is None else y[None], valid, DT)[0])


def without(*steps):
    valid = ALL.copy()
    valid[0, list(steps)] = False
    return valid


def test_a_hard_brake_is_driven_a_teleport_is_a_jump():
    assert not jumps(BRAKING[None], 0.0 * BRAKING[None], ALL[:, 1:], DT).any()
    found = jumps(10.0 * TIME[None] + 50.0 * (TIME[None] > 2.45), np.zeros((1, 40)), ALL[:, 1:], DT)
    assert np.flatnonzero(found[0]).tolist() == [24]


@pytest.mark.parametrize(
    ("x", "y"),
    [
        (10.0 * TIME, 3.2 * (TIME > 2.0)),  # to the next lane at once
        (10.0 * TIME + 14.0 * (TIME > 2.0), 0.0 * TIME),  # across a junction without lanes inside
        (np.where(TIME > 2.0, 300.0, 10.0) + TIME, 0.0 * TIME),  # a teleport
    ],
)
def test_what_no_vehicle_drives_is_a_leap(x, y):
    assert leap(x, y)


def test_a_gap_is_a_leap_only_where_the_way_goes_on_elsewhere():
    assert not leap(10.0 * TIME, valid=without(10, 11, 12))
    assert not leap(BRAKING, valid=without(*range(12, 18)))
    assert leap(10.0 * TIME + 60.0 * (TIME > 1.15), valid=without(10, 11, 12))
    assert not leap(10.0 * TIME, valid=without(*range(1, 39)))  # two samples far apart tell no motion
    assert not leap(10.0 * TIME, valid=~ALL)
