"""The models by which the vehicles around are predicted."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from regents_cosim.live.predict.car_following import CarFollowing, stops_within
from regents_cosim.live.predict.traffic import Following

FAR_M = 1e4


def accelerates(model, speed, gap, lead, wanted):
    followers = CarFollowing.of([Following(sigma=0.5 if model == "krauss" else 0.0, model=model)])
    values = (np.array([one], float) for one in (speed, gap, lead, wanted))
    return float(followers.accelerations(*values, dt=0.2)[0])


MODELS = pytest.mark.parametrize("model", ["krauss", "idm", "improved_idm"])


@MODELS
@given(speed=st.floats(0.0, 30.0), lead=st.floats(0.0, 30.0), gap=st.floats(0.1, 200.0), wanted=st.floats(1.0, 30.0))
def test_a_nearer_leader_is_never_followed_faster(model, speed, lead, gap, wanted):
    assert accelerates(model, speed, gap, lead, wanted) <= accelerates(model, speed, gap + 5.0, lead, wanted) + 1e-6


@MODELS
@given(wanted=st.floats(2.0, 30.0))
def test_alone_one_gets_to_the_speed_that_is_wanted_and_keeps_it(model, wanted):
    assert accelerates(model, 0.5 * wanted, FAR_M, 0.0, wanted) > 0.5
    assert abs(accelerates(model, wanted, FAR_M, wanted, wanted)) < 0.05
    assert accelerates(model, 1.2 * wanted, FAR_M, wanted, wanted) < -0.3


def test_only_the_improved_model_gets_as_fast_as_is_wanted_behind_a_leader():
    """At one and a half times the distance that is kept at that speed; Treiber and Kesting 2013, section 11.3.7."""
    gap = 1.5 * (2.5 + 20.0)
    plain, improved = (accelerates(model, 19.0, gap, 20.0, 20.0) for model in ("idm", "improved_idm"))
    assert plain < -0.1
    assert improved > 0.1


@pytest.mark.slow
@MODELS
@given(speed=st.floats(2.0, 20.0), further_m=st.floats(1.0, 60.0))
def test_one_that_has_room_to_stop_stops_before_the_place_and_near_it(model, speed, further_m):
    followers = CarFollowing.of([Following(sigma=0.5 if model == "krauss" else 0.0, model=model)])
    wanted, moving, stop = np.array([speed]), np.array([speed]), stops_within(np.array([speed]), followers.decel)
    stop = stop + 0.2 * speed + further_m
    for _ in range(600):
        does = followers.accelerations(moving, np.array([FAR_M]), moving, wanted, 0.1)
        does = np.minimum(does, followers.stopping(moving, stop, wanted, 0.1))
        after = np.maximum(moving + 0.1 * does, 0.0)
        stop, moving = stop - 0.05 * (moving + after), after
    assert moving < 0.1
    assert -0.5 < stop < 2.0


def test_krauss_model_brakes_for_a_place_to_stop_later_than_for_a_leader_that_stands_there():
    """SUMO's `stopSpeed` has the headway of one step, `followSpeed` that of the driver."""
    followers = CarFollowing.of([Following(sigma=0.5, model="krauss")])
    speed, stop = np.array([10.0]), np.array([14.0])
    behind = followers.accelerations(speed, stop + followers.min_gap, np.zeros(1), speed, 0.1)
    assert float(behind[0]) < -5.0
    assert float(followers.stopping(speed, stop, speed, 0.1)[0]) > 0.0
