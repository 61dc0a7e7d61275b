"""Gentler drives to a crash: the same place at the same instant along the same line, with less effort."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from regents_cosim.attacks.searches import Drive, mixtures
from regents_cosim.verdicts.usualness import peak_effort

DT, STEPS = 0.1, 60


def drive(accel, curvature=0.0, begun=5.0):
    """A drive from the origin to the east, without a stop."""
    accel = np.broadcast_to(np.asarray(accel, float), STEPS)
    speed = begun + np.concatenate([[0.0], np.cumsum(accel) * DT])
    assert speed.min() >= 0.0
    curvature = np.broadcast_to(np.asarray(curvature, float), STEPS)
    yaw = np.concatenate([[0.0], np.cumsum(curvature * 0.5 * (speed[1:] + speed[:-1]) * DT)])
    return Drive(speed, yaw, accel, curvature)


def places(made):
    gone = 0.5 * (made.speed[1:] + made.speed[:-1]) * DT
    middle = 0.5 * (made.yaw[1:] + made.yaw[:-1])
    return np.stack([np.concatenate([[0.0], np.cumsum(gone * f(middle))]) for f in (np.cos, np.sin)], axis=-1)


@settings(max_examples=15, deadline=None)
@given(st.floats(-1.0, 3.0), st.floats(-0.05, 0.05), st.integers(30, 55), st.integers(1, 25))
def test_they_come_to_the_same_place_at_the_same_instant_along_the_same_line(accel, bend, last, begins):
    hasty = drive(np.where(np.arange(STEPS) < begins, accel, 0.0), np.where(np.arange(STEPS) > 10, bend, 0.0))
    found = list(mixtures(hasty, 0, last, DT))
    assert found
    for mixed in found:
        assert mixed.speed.min() >= 0.0
        assert np.hypot(*(places(mixed)[last] - places(hasty)[last])) < 0.15
        away = np.hypot(*(places(mixed)[:last, None] - places(hasty)[None]).T).min(axis=0)
        assert away.max() < 0.5 * hasty.speed.max() * DT + 0.1  # half the way between two of its places, and a bit


def test_the_evenest_takes_less_effort_than_a_burst():
    burst = drive(np.where(np.arange(STEPS) < 10, 3.0, 0.0))
    efforts = [peak_effort(one.speed[:51], one.yaw[:51], DT) for one in (burst, *mixtures(burst, 0, 50, DT))]
    assert min(efforts) < 0.6 * efforts[0]
    assert efforts[1] == pytest.approx(min(efforts), rel=0.2)
