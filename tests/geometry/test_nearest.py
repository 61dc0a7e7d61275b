import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from regents_cosim.geometry.lines import NearestPoint

places = st.lists(st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)), min_size=1, max_size=20).map(np.array)


@given(places, places)
def test_no_point_is_nearer(points, asked):
    found = NearestPoint(points)(*asked.T)
    away = np.hypot(*(asked[:, None] - points).T).T
    np.testing.assert_allclose(away[np.arange(len(asked)), found], away.min(axis=1), atol=1e-9)


def test_it_keeps_the_shape_of_what_is_asked():
    nearest = NearestPoint(np.array([[0.0, 0.0], [10.0, 0.0]]))
    assert nearest(np.array([[1.0, 9.0], [6.0, 2.0]]), np.zeros((2, 2))).tolist() == [[0, 1], [1, 0]]
    assert nearest(np.array(8.0), np.array(1.0)) == 1
