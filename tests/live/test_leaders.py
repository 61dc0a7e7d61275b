import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from regents_cosim.live.predict.giving_way import FAR_M
from regents_cosim.live.predict.leaders import Leaders
from regents_cosim.live.predict.paths import BEHIND_M, SPACING_M

AHEAD_M = 120


def straight(front, yaw):
    """A path from a front bumper on."""
    along = np.arange(-BEHIND_M, AHEAD_M) * SPACING_M
    return front + along[:, None] * [np.cos(yaw), np.sin(yaw)]


def nearest(fronts, yaws, length, width, speed):
    """The gap on each straight path, and the leader's speed along it, by asking every body."""
    gaps, leads = np.full(len(fronts), FAR_M), speed.copy()
    for k, (front, yaw) in enumerate(zip(fronts, yaws, strict=True)):
        for other in range(len(fronts)):
            for part in (0.0, 0.5, 1.0) if other != k else ():
                way = np.array([np.cos(yaws[other]), np.sin(yaws[other])])
                off = fronts[other] - part * length[other] * way - front
                gap, aside = off @ [np.cos(yaw), np.sin(yaw)], off @ [-np.sin(yaw), np.cos(yaw)]
                beside = 0.5 * (width[k] + width[other]) + 0.1
                if abs(aside) < beside and -0.5 * length[k] < gap < gaps[k]:
                    gaps[k], leads[k] = gap, max(speed[other] * (way @ [np.cos(yaw), np.sin(yaw)]), 0.0)
    return gaps, leads


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 8))
@example(6408, 8)  # at the far corner of the cells around a point
def test_the_leader_is_the_nearest_body_on_a_straight_path(seed, count):
    random = np.random.default_rng(seed)
    fronts, yaws = random.uniform(-45.0, 45.0, (count, 2)) + 5e3, random.uniform(-np.pi, np.pi, count)
    length, width = random.uniform(3.0, 12.0, count), random.uniform(0.6, 1.8, count)  # beside: at most a cell
    speed = random.uniform(0.0, 15.0, count)
    leaders = Leaders.of([straight(*one) for one in zip(fronts, yaws, strict=True)], length, width)
    gaps, leads = leaders.ahead(np.zeros(count), speed)
    expected_gaps, expected_leads = nearest(fronts, yaws, length, width, speed)
    np.testing.assert_allclose(gaps, expected_gaps, atol=1e-6)
    np.testing.assert_allclose(leads, expected_leads, atol=1e-6)


@pytest.mark.parametrize("away_m", [150.0, 300.0, 600.0])
def test_none_leads_from_beyond_the_end_of_a_path(away_m):
    """Wherever the grid repeats itself."""
    fronts = [np.zeros(2)] + [np.array([away_m + k, 0.0]) for k in range(0, 200, 2)]
    size = np.full(len(fronts), 4.0)
    leaders = Leaders.of([straight(front, 0.0) for front in fronts], size, 0.5 * size)
    gaps, _ = leaders.ahead(np.zeros(len(fronts)), np.full(len(fronts), 10.0))
    assert gaps[0] == FAR_M
