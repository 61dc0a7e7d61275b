"""PDM-Closed in the compiled loop."""

import numpy as np
import pytest
from scenes import scene, straight_road
from shipped_cases import shipped_window
from test_careful_planner import cutting_in
from test_idm import driven

from regents_cosim.planners.idm import IDM
from regents_cosim.planners.pdm_closed import PdmClosed
from regents_cosim.replays.replay import replay

pytestmark = pytest.mark.slow


def test_it_reaches_the_limit_and_keeps_to_the_middle():
    made = scene((0, 3.2, 8.0), (200.0, 0.0, 15.0), steps=151)
    motion, controls, _ = driven(made, PdmClosed())
    assert float(motion.speed[-1]) == pytest.approx(15.0, abs=0.3)
    assert np.abs(np.asarray(motion.y) - motion.y[0]).max() < 0.05
    assert np.abs(np.asarray(controls.accel)).max() <= 1.5 + 1e-4


def test_it_passes_a_parked_car_that_reaches_into_its_lane_where_idm_stops():
    made = scene((0, 3.2, 10.0), (60.0, 1.6, 0.0), steps=121)
    motion, _, _ = driven(made, PdmClosed())
    stopped, _, _ = driven(made, IDM())
    assert float(motion.x[-1] - motion.x[0]) > 90.0
    assert 0.5 < np.max(np.asarray(motion.y) - motion.y[0]) < 1.5
    assert float(stopped.x[-1] - stopped.x[0]) < 60.0


def test_it_stays_where_the_road_is_narrow():
    made = scene((0, 0.0, 10.0), (60.0, 1.6, 0.0), steps=121, road=straight_road(1))
    motion, _, _ = driven(made, PdmClosed())
    assert np.abs(np.asarray(motion.y) - motion.y[0]).max() < 0.6
    assert float(motion.x[-1] - motion.x[0]) < 60.0


def test_a_collision_within_two_seconds_makes_it_brake():
    _, controls, _ = driven(cutting_in(3.0), PdmClosed())
    assert np.asarray(controls.accel).min() == pytest.approx(-4.05)
    calm = scene((0, 0, 12.0), (30.0, 3.2, 12.0), road=straight_road(2))
    assert np.asarray(driven(calm, PdmClosed())[1].accel).min() > -0.5


def test_it_drives_in_sumo_by_its_name_and_the_same_way_again():
    window = shipped_window("signals")
    first, again = (replay(window, "sumo", planner="pdm-closed").replayed for _ in range(2))
    assert first.tracks.steps == window.tracks.steps
    np.testing.assert_array_equal(first.tracks.x, again.tracks.x)
