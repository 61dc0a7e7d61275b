"""Real maps pass, and strips that all cross each other are refused before GEOS begins with them."""

import numpy as np
import pytest
import shapely

from regents_cosim.errors import InputError
from regents_cosim.geometry.areas import require_few_crossings, united


def strips(count, apart):
    """Strips of 4 m, half of them along x, half along y."""
    along = [shapely.box(0, apart * i, apart * count, apart * i + 4) for i in range(count // 2)]
    return along + [shapely.box(apart * i, 0, apart * i + 4, apart * count) for i in range(count // 2)]


def test_a_grid_of_long_strips_is_refused():
    with pytest.raises(InputError, match="cross each other more than"):
        require_few_crossings(strips(1000, 8))


def test_as_many_pieces_that_meet_at_their_ends_are_not():
    x = np.arange(0.0, 4000.0, 4.0)
    require_few_crossings([shapely.box(a, 9 * b, a + 4, 9 * b + 4) for a in x for b in range(20)])


def test_a_line_that_crosses_itself_everywhere_is_refused():
    corners = np.random.default_rng(0).uniform(0.0, 100.0, (1000, 2))
    for make in (shapely.LineString, shapely.Polygon):
        with pytest.raises(InputError, match="the (999|1,000) sides"):
            require_few_crossings([make(corners)])


def test_a_few_parts_may_lie_as_they_like():
    require_few_crossings(strips(20, 8))
    require_few_crossings([])


def test_ways_along_one_road_are_united_however_many_there_are():
    rng = np.random.default_rng(0)
    x = np.linspace(0.0, 300.0, 40)
    ways = [np.column_stack([x, 0.5 * x + np.cumsum(rng.normal(0.0, 0.2, len(x)))]) for i in range(400)]
    strips_ = shapely.buffer([shapely.LineString(way) for way in ways], 2.0, quad_segs=3).tolist()
    with pytest.raises(InputError):
        require_few_crossings(strips_)
    whole = shapely.union_all(strips_)
    assert shapely.symmetric_difference(united(strips_), whole).area < 1e-6 * whole.area


def test_ways_that_all_cross_are_not():
    with pytest.raises(InputError, match="cross"):
        united(strips(2000, 8))
