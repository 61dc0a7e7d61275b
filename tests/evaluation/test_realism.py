from dataclasses import replace

import numpy as np
import pytest
from scenes import TIME, crash, moving, scene
from two_car_scenes import lane_change

from regents_cosim.evaluation.crashes.realism import distances_to_traffic, motion
from regents_cosim.verdicts.behaviour import deviation_m


def test_motion_by_hand():
    made = scene((0, 0, 10.0), steps=4)
    speed, yaw = np.array([10.0, 10.2, 10.6, 10.6]), np.array([3.0, 3.1, 3.2 - 2 * np.pi, 3.2 - 2 * np.pi])
    found = motion(moving(made, 0, speed=speed, yaw=yaw).tracks, 0, 0.1)
    assert found.accel == pytest.approx([2.0, 4.0, 0.0])
    assert found.jerk == pytest.approx([20.0, -40.0])
    assert found.yaw_rate == pytest.approx([1.0, 1.0, 0.0])
    assert found.lateral == pytest.approx([10.1, 10.4, 0.0])


def test_absent_steps_are_left_out():
    made = scene((0, 0, 10.0), (20, 0, 10.0), steps=6)
    valid = np.array([True, True, False, True, True, True])
    found = motion(moving(made, 1, valid=valid, speed=np.array([1.0, 2.0, 0.0, 5.0, 6.0, 7.0])).tracks, 1, 0.1)
    assert found.accel == pytest.approx([10.0] * 3)
    assert found.jerk == pytest.approx([0.0])


def test_a_swerve_shows_against_the_traffic():
    log = scene((0, 0, 15), (15, 3.2, 10))
    yaw = np.where((TIME > 0.95) & (TIME < 1.95), -0.3, 0.0)
    attacked = crash(moving(log, 1, y=lane_change(1.0, 3.2, 0.0), yaw=yaw))
    attacked = replace(attacked, log=log.tracks)
    apart = distances_to_traffic([attacked])
    assert apart["yaw_rate"] > 0.0
    assert apart["accel"] == 0.0
    step = attacked.collision.step
    assert 0.0 < deviation_m(attacked) < 3.2 - attacked.tracks.y[1, step]


def test_without_a_collision_there_is_nothing_to_compare():
    made = scene((0, 0, 10), (50, 0, 10))
    assert distances_to_traffic([made]) == {}
    assert deviation_m(made) is None
