"""Where lines lead."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from regents_cosim.geometry.frames import wrap
from regents_cosim.geometry.lines import heading_near


@given(st.floats(-np.pi, np.pi), st.floats(0.01, 100.0), st.floats(-50.0, 150.0), st.floats(-20.0, 20.0))
def test_a_straight_line_has_one_heading_however_short_and_wherever_asked(yaw, length, along, left):
    east, north = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    line = shapely.LineString([(3.0, 4.0), np.array([3.0, 4.0]) + length * east])
    found = heading_near(line, shapely.Point(*(3.0, 4.0) + along * east + left * north))
    assert wrap(found - yaw) == pytest.approx(0.0, abs=1e-6)


def test_in_a_curve_it_is_the_heading_where_the_line_is_nearest():
    bearings = np.deg2rad(np.arange(0.0, 90.5, 0.5))
    ring = shapely.LineString(20.0 * np.column_stack([np.cos(bearings), np.sin(bearings)]))
    for bearing in np.deg2rad([10.0, 45.0, 80.0]):
        found = heading_near(ring, shapely.Point(35.0 * np.cos(bearing), 35.0 * np.sin(bearing)))
        assert wrap(found - (bearing + np.pi / 2)) == pytest.approx(0.0, abs=0.01)
