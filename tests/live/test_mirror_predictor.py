"""Everybody goes on along their own route, behind whom they follow, and stops where they have to."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import box

from regents_cosim.geometry.boxes import Boxes, overlap
from regents_cosim.live.paths import Stop, path_along
from regents_cosim.live.predict import Mirror
from regents_cosim.live.traffic import RoadUser, TrafficState
from regents_cosim.maps.roadmap import Connection, Lane, RoadMap
from regents_cosim.scenario import Agent

LIMIT = 14.0
ROAD = RoadMap(
    lanes=(
        Lane("a_0", np.array([[0.0, 0.0], [150.0, 0.0]]), 3.2, LIMIT),
        Lane("b_0", np.array([[150.0, 0.0], [400.0, 60.0]]), 3.2, LIMIT),
    ),
    connections=(Connection("a_0", "b_0"),),
    drivable=box(-50.0, -20.0, 450.0, 100.0),
)


def user(name, front_m, speed, aside=0.0, stops=(), arrives=False):
    lanes = list(ROAD.lanes) if not arrives else [ROAD.lanes[0]]
    path = path_along(lanes, front_m, (front_m, aside), 0.0, speed, 150.0, arrives, stops)
    role = "ego" if name == "ego" else "background"
    return RoadUser(Agent(name, "car", 4.7, 1.8, role), front_m - 2.35, aside, 0.0, speed, path)


def predicted(*users, steps=51):
    return Mirror().predict(TrafficState(0.0, users, ROAD, {}), 0.1, steps)


@given(gap=st.floats(3.0, 60.0), speed=st.floats(0.0, LIMIT), lead=st.floats(0.0, LIMIT))
@settings(max_examples=20)
def test_a_follower_never_touches_a_leader_that_it_can_brake_for(gap, speed, lead):
    if speed > lead and gap < 2.5 + (speed**2 - lead**2) / (2.0 * 4.0) + speed:
        return
    tracks = predicted(user("ego", 30.0 + 4.7 + gap, lead), user("x", 30.0, speed))
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
