"""When an adversary stops so as not to touch another vehicle than the ego, and when it drives on."""

import dataclasses

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from regents_cosim.geometry.boxes import Boxes, overlap
from regents_cosim.live.host.interface import Frame
from regents_cosim.live.predict.forecast import Forecast
from regents_cosim.live.predict.moments import DT_S
from regents_cosim.live.safety import braking, would_touch_others
from regents_cosim.live.search.plan import Plan
from regents_cosim.scenario.scenario import Tracks
from regents_cosim.simulators.sumo.types import VehicleType

CAR = VehicleType("car", 5.0, 1.8)
STEPS = 81
SINCE_S = np.arange(STEPS) * DT_S
EGO = (300.0, 100.0, 0.0, 10.0)  # x, y [m], yaw [rad], speed [m/s]: far away
IDS = ("ego", "mine", "other")


def a_frame(time_s, mine, other):
    x, y, yaw, speed = np.array([EGO, mine, other]).T
    return Frame(time_s, IDS, x, y, yaw, speed, np.zeros(3), (CAR,) * 3, {})


def straight(x_m, speed_m_s):
    """The plan to go on at that speed along y = 0, from there on."""
    flat = np.zeros(STEPS)
    return Plan("mine", 0.0, x_m + speed_m_s * SINCE_S, flat, flat, np.full(STEPS, speed_m_s), meets_s=7.0)


def foreseen(x_m, y_m, yaw):
    """That the other will be there [time]; the ego and the adversary stay out of it."""
    away = np.full(STEPS, 500.0)
    rows = np.stack([away, away, np.broadcast_to(x_m, STEPS)]), np.stack([away, -away, np.broadcast_to(y_m, STEPS)])
    turned = np.stack([0.0 * away, 0.0 * away, np.broadcast_to(yaw, STEPS)])
    return Forecast(0.0, DT_S, IDS, Tracks(*rows, turned, np.zeros((3, STEPS)), np.ones((3, STEPS), bool)))


def test_it_follows_a_leader_that_is_about_to_go():
    plan = dataclasses.replace(straight(0.0, 3.0), foreseen=foreseen(7.0 + 1.5 * SINCE_S**2, 0.0, 0.0))
    frame = a_frame(0.0, (0.0, 0.0, 0.0, 3.0), (7.0, 0.0, 0.0, 0.0))  # touches after 0.67 s if the leader stays
    assert not would_touch_others(frame, plan, 0.1)


def test_it_stops_where_the_other_is_foreseen_to_be_in_its_way():
    cuts_in = foreseen(20.0 - 8.0 * SINCE_S, 0.0, 0.0)
    plan = dataclasses.replace(straight(0.0, 12.0), foreseen=cuts_in)
    frame = a_frame(0.0, (0.0, 0.0, 0.0, 12.0), (20.0, 0.0, 0.0, 12.0))  # straight on they never meet
    assert would_touch_others(frame, plan, 0.1)
    assert not would_touch_others(frame, straight(0.0, 12.0), 0.1)


def test_it_drives_on_where_a_crossing_vehicle_is_foreseen_to_turn_away():
    turns = foreseen(8.0 + 0.0 * SINCE_S, 8.0 - 7.0 * np.minimum(SINCE_S, 0.5), 0.0)
    frame = a_frame(0.0, (0.0, 0.0, 0.0, 5.0), (8.0, 8.0, -np.pi / 2.0, 7.0))  # straight on they meet after 0.8 s
    plan = straight(0.0, 5.0)
    assert not would_touch_others(frame, dataclasses.replace(plan, foreseen=turns), 0.1)


@pytest.mark.slow
@pytest.mark.parametrize("step_s", [0.05, 0.1, 0.2, 0.5])
@settings(max_examples=40)
@given(st.floats(0.5, 25.0), st.floats(0.5, 30.0), st.floats(0.0, 12.0), st.booleans())
@example(0.5, 0.5, 0.4, True)  # bumper to bumper after five seconds
def test_it_never_touches_a_leader_for_whom_it_can_brake(step_s, speed_m_s, room_m, lead_m_s, goes):
    """Whatever was foreseen of the leader, which in truth goes on at its speed."""
    needed_m = speed_m_s**2 / (2.0 * 7.0) + (speed_m_s + 1.0) * step_s
    leader_m = 5.0 + max(room_m, needed_m)
    plan = straight(0.0, speed_m_s)
    if goes:
        plan = dataclasses.replace(plan, foreseen=foreseen(leader_m + 30.0 * SINCE_S, 0.0, 0.0))
    stopping, time_s = False, 0.0
    while time_s < 5.0:
        x_m, y_m, yaw, speed = plan.at(time_s)
        other = (leader_m + lead_m_s * time_s, 0.0, 0.0, lead_m_s)
        frame = a_frame(time_s, (x_m, y_m, yaw, speed), other)
        assert not overlap(*(Boxes(*(np.asarray(v)[k] for v in frame.boxes)) for k in (1, 2)))
        if not stopping and would_touch_others(frame, plan, step_s):
            stopping, plan = True, braking(plan, time_s)
        time_s += step_s


def test_one_that_touches_already_is_left_as_it_is():
    frame = a_frame(0.0, (0.0, 0.0, 0.0, 5.0), (4.0, 0.0, 0.0, 0.0))
    assert not would_touch_others(frame, straight(0.0, 5.0), 0.1)


def test_one_that_goes_around_a_bend_counts_along_its_way():
    """At its speed, but not across the lane that it comes near and turns away from, as in a roundabout."""
    yaw = np.maximum(0.5 * np.pi - 2.0 * SINCE_S, 0.0)
    way = np.cumsum(np.stack([np.cos(yaw), np.sin(yaw)]) * 8.0 * DT_S, axis=1)
    bends = foreseen(10.0 + way[0] - way[0, 0], -7.5 + way[1] - way[1, 0], yaw)

    def stops(known):
        frames = [(x_m, a_frame(0.0, (x_m, 0.0, 0.0, 10.0), (10.0, -7.5, 0.5 * np.pi, 8.0))) for x_m in range(-10, 4)]
        plans = [(dataclasses.replace(straight(x_m, 10.0), foreseen=known), frame) for x_m, frame in frames]
        return any(would_touch_others(frame, plan, 0.1) for plan, frame in plans)

    assert stops(None)
    assert not stops(bends)
