import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from regents_cosim.geometry.frames import (
    Pose,
    SumoPose,
    from_highway,
    from_sumo,
    points_from_highway,
    points_to_highway,
    to_highway,
    to_sumo,
    wheel_from_curvature,
    wrap,
)


@given(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), st.floats(-20, 20), st.floats(0.5, 20))
def test_to_sumo_and_back(x, y, yaw, length):
    back = from_sumo(to_sumo(Pose(x, y, yaw), length), length)
    assert (back.x, back.y) == pytest.approx((x, y), abs=1e-8)
    assert np.exp(1j * back.yaw) == pytest.approx(np.exp(1j * yaw), abs=1e-9)


@pytest.mark.parametrize(
    ("angle", "front"), [(90.0, (2.0, 0.0)), (180.0, (0.0, -2.0)), (0.0, (0.0, 2.0)), (270.0, (-2.0, 0.0))]
)
def test_sumo_gives_the_front_bumper_and_degrees_clockwise_from_north(angle, front):
    pose = from_sumo(SumoPose(*front, angle), 4.0)
    assert (pose.x, pose.y) == pytest.approx((0, 0), abs=1e-12)


@given(st.floats(-100, 100))
def test_wrap_keeps_the_direction(angle):
    wrapped = wrap(angle)
    assert -np.pi < wrapped <= np.pi
    assert np.exp(1j * wrapped) == pytest.approx(np.exp(1j * angle), abs=1e-9)


@given(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), st.floats(-20, 20))
def test_to_highway_and_back_is_exact(x, y, yaw):
    assert from_highway(to_highway(Pose(x, y, yaw))) == Pose(x, y, yaw)
    np.testing.assert_array_equal(points_from_highway(points_to_highway(np.array([[x, y]]))), [[x, y]])


def test_in_highway_env_north_is_up_the_screen_and_a_left_turn_lowers_the_heading():
    north = to_highway(Pose(0.0, 1.0, np.pi / 2))
    assert (north.y, north.heading) == (-1.0, -np.pi / 2)
    assert wheel_from_curvature(0.1, 5.0) < 0.0


@given(st.floats(-1.4, 1.4), st.floats(2.0, 20.0))
def test_the_wheel_gives_highway_env_the_curvature(steering, length):
    """Its `Vehicle.step` turns by v sin(beta) / (length / 2) per second, beta = arctan(tan(steering) / 2)."""
    curvature = -2.0 * np.sin(np.arctan(0.5 * np.tan(steering))) / length
    assert wheel_from_curvature(curvature, length) == pytest.approx(steering, abs=1e-9)


@given(st.floats(-5.0, 5.0), st.floats(2.0, 20.0))
def test_a_curvature_that_the_wheels_cannot_reach_gives_finite_angles(curvature, length):
    assert abs(wheel_from_curvature(curvature, length)) <= np.pi / 2
