"""Everybody goes on along their own route, behind whom they follow, and stops where they have to."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import box

from regents_cosim.geometry.boxes import Boxes, overlap
from regents_cosim.live.predict.moments import Moments
from regents_cosim.live.predict.paths import Stop, path_along
from regents_cosim.live.predict.traffic import Following, RoadUser, TrafficState
from regents_cosim.live.predict.traffic_ahead import CarFollowingPredictor
from regents_cosim.live.search.replanner import Replanner
from regents_cosim.maps.roadmap import Connection, Lane, RoadMap
from regents_cosim.scenario.scenario import Agent

LIMIT = 14.0
KRAUSS, IDM = Following(sigma=0.5, model="krauss"), Following(model="idm")
ROAD = RoadMap(
    lanes=(
        Lane("a_0", np.array([[0.0, 0.0], [150.0, 0.0]]), 3.2, LIMIT),
        Lane("b_0", np.array([[150.0, 0.0], [400.0, 60.0]]), 3.2, LIMIT),
    ),
    connections=(Connection("a_0", "b_0"),),
    drivable=box(-50.0, -20.0, 450.0, 100.0),
)


def user(name, front_m, speed, aside=0.0, stops=(), arrives=False, following=IDM):
    lanes = list(ROAD.lanes) if not arrives else [ROAD.lanes[0]]
    path = replace(path_along(lanes, front_m, (front_m, aside), 0.0, speed, 150.0, arrives), stops=stops)
    role = "ego" if name == "ego" else "background"
    return RoadUser(Agent(name, "car", 4.7, 1.8, role), front_m - 2.35, aside, 0.0, speed, path, following)


def predicted(*users, steps=51):
    return CarFollowingPredictor().predict(TrafficState(0.0, users, ROAD, {}), 0.1, steps)


@given(
    gap=st.floats(3.0, 60.0),
    speed=st.floats(0.0, LIMIT),
    lead=st.floats(0.0, LIMIT),
    follows=st.sampled_from([IDM, KRAUSS]),
)
@settings(max_examples=30)
def test_a_follower_never_touches_a_leader_that_it_can_brake_for(gap, speed, lead, follows):
    if speed > lead and gap < 2.5 + (speed**2 - lead**2) / (2.0 * 4.0) + speed:
        return
    tracks = predicted(user("ego", 30.0 + 4.7 + gap, lead), user("x", 30.0, speed, following=follows))
    one, two = (Boxes(tracks.x[k], tracks.y[k], tracks.yaw[k], 4.7, 1.8) for k in (0, 1))
    assert not overlap(one, two).any()


def test_everybody_begins_exactly_where_they_are_and_comes_to_the_middle_of_the_lane():
    tracks = predicted(user("ego", 30.0, 10.0, aside=1.2))
    assert np.allclose([tracks.x[0, 0], tracks.y[0, 0], tracks.yaw[0, 0]], [27.65, 1.2, 0.0])
    assert abs(tracks.y[0, -1]) < 0.2
    assert np.abs(np.diff(tracks.y[0])).max() < 0.12


def test_a_red_light_is_stopped_at_and_no_other_place():
    tracks = predicted(user("ego", 30.0, 10.0, stops=(Stop(40.0),)), steps=121)
    assert 66.0 < tracks.x[0, -1] + 2.35 < 70.5
    assert tracks.speed[0, -1] < 0.3


def test_who_arrives_is_gone_from_there_on():
    tracks = predicted(user("ego", 30.0, 10.0), user("x", 140.0, 10.0, arrives=True))
    assert tracks.valid[1, 0]
    assert not tracks.valid[1, -1]
    assert tracks.valid[0].all()


def test_the_limit_is_kept():
    tracks = predicted(user("ego", 30.0, 5.0), steps=101)
    assert tracks.speed[0].max() <= LIMIT * 1.001
    assert tracks.speed[0, -1] > 12.0


def test_a_light_is_waited_for_as_long_as_it_is_red():
    tracks = predicted(user("ego", 30.0, 10.0, stops=(Stop(40.0, (0.0, 4.0)),)), steps=121)
    assert tracks.x[0, 40] + 2.35 < 70.5
    assert tracks.x[0, -1] + 2.35 > 90.0


def test_who_can_no_longer_stop_when_a_light_turns_drives_on():
    far, near = (predicted(user("ego", 30.0, 13.0, stops=(Stop(at_m, (1.0, np.inf)),)), steps=81) for at_m in (50, 20))
    assert far.x[0, -1] + 2.35 < 80.5
    assert near.x[0, -1] + 2.35 > 100.0


def test_by_krauss_one_speeds_up_by_all_it_has_less_what_it_dawdles():
    tracks = predicted(user("ego", 30.0, 5.0, following=KRAUSS), steps=11)
    assert abs(tracks.speed[0, -1] - 5.0 - 2.6 * 0.75) < 0.05
    following = predicted(user("ego", 60.0, 10.0, following=KRAUSS), user("x", 42.0, 10.0, following=KRAUSS), steps=2)
    assert following.speed[1, 1] <= 10.2  # behind a leader at the distance that it wants: 10 m and what SUMO adds


@given(accel=st.floats(-6.0, 2.6), speed=st.floats(3.0, 12.0), follows=st.sampled_from([IDM, KRAUSS]))
@settings(max_examples=30)
def test_each_goes_on_for_a_moment_as_it_did_lately(accel, speed, follows):
    one = replace(user("ego", 30.0, speed, following=follows), accel=accel)
    tracks = predicted(one, steps=11)
    assert np.allclose(tracks.speed[0, :3], speed + accel * np.array([0.0, 0.1, 0.2]), atol=1e-6)
    onward = predicted(user("ego", 30.0, tracks.speed[0, 2], following=follows), steps=3)
    if follows is KRAUSS:  # from then on as its model says, which knows no jerk
        assert np.allclose(tracks.speed[0, 2:5], onward.speed[0], atol=0.01)


def test_what_sumo_says_of_a_vehicle_that_was_moved_by_hand_is_not_taken_for_its_acceleration():
    tracks = predicted(replace(user("ego", 30.0, 8.0), accel=40.0), steps=3)
    assert tracks.speed[0, -1] <= 8.0 + 0.2 * IDM.accel + 1e-6
    tracks = predicted(replace(user("ego", 30.0, 8.0), accel=-80.0), steps=3)
    assert tracks.speed[0, -1] >= 8.0 - 0.2 * 8.0 - 1e-6


@pytest.mark.parametrize(("planner", "fastest"), [("observed", 8.0), ("idm", 8.4)])
def test_an_observed_ego_keeps_to_its_recent_speed_whatever_it_does_just_now(planner, fastest):
    traffic = TrafficState(0.0, (replace(user("ego", 30.0, 8.0), accel=2.0),), ROAD, {})
    history = SimpleNamespace(recent_m_s=lambda: 8.0)
    host = SimpleNamespace(traffic=lambda frame, most, horizon_s: traffic)
    replanner = Replanner(host, SimpleNamespace(planner_name=planner), Moments(CarFollowingPredictor(), 5.0), history)
    speed = replanner.forecast(SimpleNamespace(time_s=0.0)).tracks.speed[0]
    assert speed[2] == pytest.approx(fastest, abs=0.01)


def test_others_brake_for_one_whose_drive_is_known():
    """It brakes to a stop on their lane, which its route would not have told."""
    speed = np.maximum(10.0 - 4.0 * 0.1 * np.arange(121), 0.0)
    x = 57.65 + np.concatenate([[0.0], np.cumsum(0.05 * (speed[1:] + speed[:-1]))])
    known = {"first": np.stack([x, 0.0 * x, 0.0 * x, speed])}
    users = user("ego", 25.0, 10.0), user("first", 60.0, 10.0)
    traffic = TrafficState(0.0, users, ROAD, {})
    told, untold = (CarFollowingPredictor().predict(one, 0.1, 121) for one in (traffic.driving(known), traffic))
    assert np.abs(told.x[1] - x).max() < 0.2
    assert told.speed[0, -1] < 0.3
    assert told.x[0, -1] < x[-1] - 4.7
    assert untold.speed[0, -1] > 10.0
