"""IDM that gives way."""

import jax.numpy as jnp
import numpy as np
import pytest
from shipped_cases import shipped_window, shipped_windows
from test_idm import driven

from regents_cosim.cases.suite import load_suite
from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.rollout import Traffic
from regents_cosim.planners.idm import IDM
from regents_cosim.planners.idm_yielding import PriorityWays, YieldingIDM, _claimed, _priority_ways
from regents_cosim.routes.route import route_into_gaps
from regents_cosim.sources.record import record


def way_from_the_right():
    """One way northward that is crossed 20 to 24 m along a route to the east, at x = 22 m."""
    back = 3.0 * np.arange(-31, 1, dtype=np.float32)
    return PriorityWays(
        begin=jnp.array([20.0]), end=jnp.array([24.0]), x=jnp.full((1, 32), 22.0), y=jnp.array([back]),
        yaw=jnp.full((1, 32), 0.5 * jnp.pi), holds=jnp.array([[True]]),
    )  # fmt: skip


def cars(*states):
    x, y, yaw, speed = (jnp.array(values, jnp.float32) for values in zip(*states, strict=True))
    size = jnp.full(len(states), 2.3)
    return Traffic(Motion(x, y, yaw, speed), jnp.ones(len(states), bool), size, 0.4 * size)


NORTH = 0.5 * np.pi


@pytest.mark.parametrize(
    ("other", "claimed"),
    [
        ((22.0, -25.0, NORTH, 10.0), True),  # both arrive after two and a half seconds
        ((22.0, -90.0, NORTH, 10.0), False),  # long after the ego
        ((22.0, 8.0, NORTH, 10.0), False),  # has passed
        ((22.0, -25.0, NORTH, 0.0), False),  # waits
        ((22.0, -25.0, -NORTH, 10.0), False),  # drives away
        ((27.0, -25.0, NORTH, 10.0), False),  # on another lane
    ],
)
def test_a_way_is_claimed_by_one_who_passes_when_the_ego_would(other, claimed):
    found = _claimed(way_from_the_right(), cars(other), jnp.float32(0.0), jnp.float32(2.3), jnp.float32(8.0))
    assert found.tolist() == [claimed]


def test_one_that_is_too_far_ahead_to_stop_for_claims_nothing():
    inside = _claimed(
        way_from_the_right(), cars((22.0, -25.0, NORTH, 10.0)), jnp.float32(21.0), jnp.float32(2.3), jnp.float32(8.0)
    )
    assert inside.tolist() == [False]


@pytest.mark.slow
def test_with_priority_everywhere_it_drives_as_idm():
    window = shipped_window("multilane")
    assert not _priority_ways(route_into_gaps(window), window, np.zeros(2)).holds.any()
    motion, _, _ = driven(window, YieldingIDM())
    usual, _, _ = driven(window, IDM())
    np.testing.assert_allclose(motion.x, usual.x, atol=1e-3)


def test_red_lights_hold_those_with_priority():
    for window in shipped_windows("signals"):
        route, first = route_into_gaps(window), {one.id: one.letters(0) for one in window.signals}
        held = np.asarray(_priority_ways(route, window, np.zeros(2)).holds)[0]
        kept = [one for one in route.meetings if one.ego_yields and one.kind != "pedestrians"][: len(held)]
        for one, holds in zip(kept, held, strict=False):
            mine, theirs = (first[light.signal][light.link] for light in (one.light, one.other_light))
            assert holds == (mine == "r" or theirs in "gG"), window.id


def test_at_the_entry_of_a_roundabout_those_on_the_ring_have_priority():
    case = next(one for one in load_suite("shipped:quickstart") if one.id.startswith("roundabout-00388.8s"))
    assert np.asarray(_priority_ways(route_into_gaps(case), case, np.zeros(2)).holds).any()


@pytest.mark.slow
def test_ways_lead_to_where_the_route_meets_them():
    met = 0
    for window in record("shipped:roundabout", count=12, seed=5, prefer="none", tell=lambda _: None):
        route = route_into_gaps(window)
        ways = _priority_ways(route, window, np.zeros(2))
        for at in np.flatnonzero(np.asarray(ways.holds).any(axis=0)):
            met += 1
            middle = route.at(0.5 * float(ways.begin[at] + ways.end[at]))
            last = np.array([ways.x[at, -1], ways.y[at, -1]])
            assert np.hypot(*(last - [middle.x, middle.y])) < 2.5
            steps = np.hypot(np.diff(ways.x[at]), np.diff(ways.y[at]))
            assert (steps < 3.01).all()
            assert (steps > 2.0).all()
    assert met
