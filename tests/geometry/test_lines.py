"""Directions and positions along lines."""

import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely.ops import substring

from regents_cosim.geometry.frames import wrap
from regents_cosim.geometry.lines import distances_along, heading_near, points_at, seconds_for, stretch


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


metres = st.floats(-100.0, 100.0).map(lambda value: round(value, 6))  # shapely divides by tinier differences
places = st.tuples(metres, metres)


@given(st.lists(places, min_size=2, max_size=8, unique=True), st.floats(0.0, 1.0))
def test_the_point_at_a_distance_along_a_line_lies_there(points, part):
    line, corners = shapely.LineString(points), np.array(points)
    along = distances_along(*corners.T)
    assert along[0] == 0.0
    assert along[-1] == pytest.approx(line.length)
    assert points_at(along, along, corners) == pytest.approx(corners, abs=1e-6)
    expected = shapely.get_coordinates(line.interpolate(part * line.length))[0]
    assert points_at(part * along[-1], along, corners) == pytest.approx(expected, abs=1e-6)


def test_distances_along_many_lines_are_those_along_each_on_host_and_device():
    x, y = np.random.default_rng(0).normal(0.0, 10.0, (2, 3, 5))
    each = np.array([distances_along(*one) for one in zip(x, y, strict=True)])
    assert distances_along(x, y) == pytest.approx(each)
    assert distances_along(jnp.asarray(x), jnp.asarray(y), jnp) == pytest.approx(each, rel=1e-5)


@given(st.lists(places, min_size=2, max_size=8, unique=True), st.floats(0.0, 0.99), st.floats(0.01, 1.5))
def test_a_stretch_is_that_part_of_the_line(points, begin, longer):
    line = shapely.LineString(points)
    begin_m, end_m = begin * line.length, (begin + longer) * line.length
    found, expected = stretch(np.array(points), begin_m, end_m), substring(line, begin_m, end_m)
    assert found[[0, -1]] == pytest.approx(shapely.get_coordinates(expected)[[0, -1]], abs=1e-6)
    assert shapely.LineString(found).length == pytest.approx(expected.length, abs=1e-6)
    assert shapely.hausdorff_distance(shapely.LineString(found), expected) < 1e-6


def test_beyond_its_end_a_line_has_that_end_alone():
    assert stretch(np.array([[0.0, 0.0], [3.0, 4.0]]), 7.0).tolist() == [[3.0, 4.0], [3.0, 4.0]]


def test_who_may_not_drive_never_arrives():
    assert seconds_for(10.0, 0.0, 2.5, 0.0) == np.inf
    np.testing.assert_array_equal(seconds_for(np.array([0.0, 10.0]), 0.0, 2.5, np.zeros(2)), [0.0, np.inf])
