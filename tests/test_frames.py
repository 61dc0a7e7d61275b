import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from regents_cosim.frames import Pose, SumoPose, from_sumo, to_sumo, wrap


@given(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), st.floats(-20, 20), st.floats(0.5, 20))
def test_to_sumo_and_back(x, y, yaw, length):
    back = from_sumo(to_sumo(Pose(x, y, yaw), length), length)
    assert (back.x, back.y) == pytest.approx((x, y), abs=1e-8)
    assert np.exp(1j * back.yaw) == pytest.approx(np.exp(1j * yaw), abs=1e-9)


@pytest.mark.parametrize(("angle", "front"), [(90, (2, 0)), (180, (0, -2)), (0, (0, 2)), (270, (-2, 0))])
def test_sumo_gives_the_front_bumper_and_degrees_clockwise_from_north(angle, front):
    pose = from_sumo(SumoPose(*front, angle), 4.0)
    assert (pose.x, pose.y) == pytest.approx((0, 0), abs=1e-12)


@given(st.floats(-100, 100))
def test_wrap_keeps_the_direction(angle):
    wrapped = wrap(angle)
    assert -np.pi < wrapped <= np.pi
    assert np.exp(1j * wrapped) == pytest.approx(np.exp(1j * angle), abs=1e-9)
