"""Gaps between strips are closed, and the resulting area is valid for GEOS."""

import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st

from regents_cosim.geometry.areas import closed

places = st.tuples(st.integers(-40, 40), st.integers(-40, 40)).map(lambda at: (0.1 * at[0], 0.1 * at[1]))


def strips(*lines):
    return shapely.union_all([shapely.LineString(line).buffer(0.8, cap_style="flat", quad_segs=2) for line in lines])


def test_a_gap_is_filled_and_corners_stay():
    area = shapely.union(shapely.box(0.0, 0.0, 1.0, 1.0), shapely.box(1.3, 0.0, 2.0, 1.0))
    assert shapely.symmetric_difference(closed(area, 0.2), shapely.box(0.0, 0.0, 2.0, 1.0)).area < 1e-6
    apart = shapely.union(shapely.box(0.0, 0.0, 1.0, 1.0), shapely.box(1.5, 0.0, 2.0, 1.0))
    assert closed(apart, 0.2).area == pytest.approx(apart.area)


def test_edges_that_cross_are_mended():
    area = strips([(-3.7, -2.3), (1.3, 0.9)], [(2.3, 2.1), (0.0, 3.5)])
    assert not area.buffer(0.2, join_style="mitre").buffer(-0.2, join_style="mitre").is_valid, "as GEOS is known to do"
    found = closed(area, 0.2)
    assert found.is_valid
    assert shapely.difference(area, found).area == pytest.approx(0.0, abs=1e-6), "it has lost one of the two strips"
    assert shapely.intersection(found, shapely.box(0.0, 0.0, 2.0, 2.0)).area > 0.0


@example([((0.1, 4.0), (-1.3, 1.7000000000000002)), ((-1.6, 0.4), (3.6, 0.2))])
@given(st.lists(st.tuples(places, places).filter(lambda two: two[0] != two[1]), min_size=1, max_size=4))
def test_it_is_valid_and_has_all_strips(lines):
    found = closed(strips(*lines), 0.2)
    assert found.is_valid
    assert {part.geom_type for part in shapely.get_parts(found)} == {"Polygon"}
    for line in lines:  # the sharpest corners between two strips may go
        assert shapely.difference(shapely.LineString(line), found.buffer(1e-3)).length == pytest.approx(0.0, abs=1e-6)
