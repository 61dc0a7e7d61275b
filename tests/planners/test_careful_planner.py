"""The careful driver as a planner, in the compiled loop."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from careful_scenes import aside
from scenes import scene, straight_road
from test_idm import driven

from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.norms.careful import CAREFUL
from regents_cosim.norms.limits import ACCEL_LIMIT
from regents_cosim.planners.careful.driver import CarefulDriver
from regents_cosim.planners.jax_planner import JaxPlanner


def cutting_in(gap, lateral=1.0, speed=12.0, other=7.0):
    """Traffic in which a slower car cuts in after 1 s, `gap` [m] ahead of an ego that keeps its speed."""
    made = scene((0, 0, speed), (gap + 4.6 + speed - other, 3.2, other), road=straight_road(2))
    return replace(made, tracks=aside(made, lateral, other))


@pytest.mark.slow
def test_it_brakes_hard_for_a_cut_in_and_drives_on_as_idm_does_without():
    planner = CarefulDriver()
    _, controls, _ = driven(cutting_in(6.0), planner)
    assert np.asarray(controls.accel).min() < -4.0
    assert np.asarray(controls.accel).min() >= -planner.most_braking_m_s2
    beside = scene((0, 0, 12.0), (30.0, 3.2, 12.0), road=straight_road(2))
    _, calm, _ = driven(beside, planner)
    _, idm, _ = driven(beside, planner.idm)
    np.testing.assert_allclose(calm.accel, idm.accel, rtol=1e-5)  # two programs, rounded differently


class Slams(JaxPlanner):
    """A planner that brakes as hard as it may."""

    def step(self, memory, sight, ego):
        return ControlArrays(jnp.float32(-100.0), jnp.float32(0.0)), memory


class SlamsHarder(Slams):
    most_braking_m_s2 = CAREFUL.most_braking_m_s2


def test_a_planner_brakes_no_harder_than_it_may():
    made = scene((0, 0, 20.0), (100.0, 3.2, 20.0), road=straight_road(2))
    for planner, most in ((Slams(), ACCEL_LIMIT), (SlamsHarder(), CAREFUL.most_braking_m_s2)):
        _, controls, _ = driven(made, planner)
        assert np.asarray(controls.accel)[0] == pytest.approx(-most)
    assert CarefulDriver.most_braking_m_s2 == CAREFUL.most_braking_m_s2
