import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st
from scenes import straight_road
from scipy.ndimage import gaussian_filter
from scipy.stats import norm

from regents_cosim.errors import ScenarioError
from regents_cosim.geometry.rasters import inside
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.mirror.road_field import CELL_M, SIGMA_M, blur, blur_areas

ROAD = straight_road(lanes=2, width=4.0)  # drivable for -2 <= y <= 6


def field_of(road=ROAD, origin=(0.0, 0.0), low=(-40.0, -10.0), high=(40.0, 20.0)):
    return blur(road, np.array(low), np.array(high), np.array(origin))


def lookup(field, x, y):
    return np.asarray(field(jnp.asarray(x, jnp.float32), jnp.asarray(y, jnp.float32)))


def test_it_is_the_blurred_edge_of_the_road():
    across = np.linspace(-6, 1, 71)
    exact = norm.cdf((-2 - across) / SIGMA_M)
    half_a_cell = 0.5 * CELL_M * norm.pdf(0) / SIGMA_M  # the edge lies anywhere within its cell
    assert lookup(field_of(), np.zeros(71), across) == pytest.approx(exact, abs=half_a_cell + 0.01)


def test_an_extent_that_memory_does_not_hold_is_refused():
    with pytest.raises(ScenarioError, match=r"spread over 1e\+05 km by 0.05\d* km, expected at most 2.7 square"):
        field_of(high=(1e8, 20.0))


def test_zero_on_the_road_and_one_far_off():
    assert lookup(field_of(), [0.0, 10.0], [2.0, 1.0]) == pytest.approx(0, abs=1e-3)
    assert lookup(field_of(), [0.0, 0.0], [-9.0, 15.0]) == pytest.approx(1, abs=1e-3)


def short_road():
    return RoadMap(ROAD.lanes, (), shapely.box(-60.0, -2.0, 60.0, 6.0))


def test_scenes_share_the_field_of_a_road_that_takes_no_more_room_as_a_whole():
    road = short_road()
    here, there = field_of(road), field_of(road, low=(-30.0, -8.0), origin=(30.0, -7.0))
    assert here.cells is there.cells
    assert here.cells is not field_of(short_road()).cells
    assert field_of().cells is not field_of().cells  # too long


def test_the_field_of_all_of_a_road_is_that_of_a_part():
    part, whole = field_of(), field_of(short_road())
    assert part.shape.tolist() != whole.shape.tolist()
    x, y = np.random.default_rng(0).uniform((-39, -9), (39, 19), (200, 2)).T
    assert lookup(part, x, y) == pytest.approx(lookup(whole, x, y), abs=1e-4)


def test_the_gradient_points_off_the_road():
    slope = jax.grad(lambda y: field_of()(jnp.float32(3.0), y))
    assert slope(jnp.float32(-2.0)) < -0.3
    assert slope(jnp.float32(6.0)) > 0.3
    assert slope(jnp.float32(2.0)) == pytest.approx(0, abs=1e-3)


def test_its_slope_is_that_of_finite_differences(x64):
    field = jax.tree.map(lambda v: v.astype(jnp.float64) if v.dtype == jnp.float32 else v, field_of())
    # Beside the middle of a cell, where the bilinear field has no kink, and beyond the grid.
    x = CELL_M * np.array([3.3, -17.6, 40.2, 1e4]) + field.corner[0] % CELL_M
    y = CELL_M * np.array([-8.4, 31.3, -9.7, -8.4]) + field.corner[1] % CELL_M
    east, north = jax.grad(lambda *at: field(*at).sum(), (0, 1))(jnp.asarray(x), jnp.asarray(y))
    assert np.abs(north).max() > 0.5
    for slope, dx, dy in ((east, 1e-5, 0.0), (north, 0.0, 1e-5)):
        difference = (field(x + dx, y + dy) - field(x - dx, y - dy)) / 2e-5
        assert np.asarray(slope) == pytest.approx(np.asarray(difference), abs=1e-6)


def test_points_beyond_the_grid_take_the_value_at_its_border():
    assert lookup(field_of(), [1e6, 0.0], [2.0, 1e6]).tolist() == pytest.approx([0.0, 1.0], abs=1e-3)


def test_the_origin_only_shifts_it():
    here, there = field_of(), field_of(origin=(30.0, -7.0))
    x, y = np.random.default_rng(0).uniform((-39, -9), (39, 19), (200, 2)).T
    assert lookup(here, x, y) == pytest.approx(lookup(there, x - 30.0, y + 7.0), abs=1e-4)


def test_rows_are_y_and_columns_are_x():
    road = RoadMap(ROAD.lanes, (), shapely.box(10.0, -50.0, 30.0, 50.0))
    assert lookup(field_of(road), [20.0, 0.0], [0.0, 20.0]).tolist() == pytest.approx([0.0, 1.0], abs=1e-3)


def test_holes_are_off_the_road():
    road = RoadMap(ROAD.lanes, (), shapely.box(-50, -20, 50, 30).difference(shapely.Point(0, 5).buffer(4)))
    assert lookup(field_of(road), [0.0, 20.0], [5.0, 5.0]).tolist() == pytest.approx([1.0, 0.0], abs=1e-3)


def millimetres(low, high):
    """Lengths [m] in whole millimetres from `low` to `high`, since shapely merges points that nearly coincide."""
    return st.integers(1000 * low, 1000 * high).map(lambda length: length / 1000)


@pytest.mark.slow
@given(st.lists(st.tuples(millimetres(-12, 12), millimetres(-9, 9), millimetres(1, 7)), min_size=1, max_size=6))
def test_the_raster_is_that_of_its_cell_centres(discs):
    x, y, size = np.array(discs).T
    area = shapely.union_all(shapely.buffer(shapely.points(x, y), size))
    for holed in (area, area.difference(shapely.Point(x[0], y[0]).buffer(0.5 * size[0]))):
        raster = inside(holed, np.array([-8.05, -5.03]), (51, 82), 0.2)
        east, north = np.meshgrid(-8.05 + 0.2 * np.arange(82), -5.03 + 0.2 * np.arange(51))
        clear = shapely.distance(holed.boundary, shapely.points(east, north)) > 1e-9
        assert (raster == shapely.contains_xy(holed, east, north))[clear].all()


def test_an_area_that_is_empty_or_elsewhere_fills_nothing():
    for area in (shapely.Polygon(), shapely.box(100.0, 100.0, 101.0, 101.0)):
        assert not inside(area, np.zeros(2), (5, 70), 0.2).any()


@pytest.mark.slow
@given(st.integers(0, 1000))
def test_it_is_a_gaussian_filter_of_the_map(seed):
    x, y, width, height = np.random.default_rng(seed).uniform(
        [[-20.0], [-10.0], [0.5], [0.5]], [[20], [10], [9], [9]], (4, 6)
    )
    area = shapely.union_all(shapely.box(x, y, x + width, y + height))
    low, high = np.array([-25.0, -15.0]), np.array([25.0, 15.0])
    field = blur_areas([area], low, high, np.zeros(2))
    edges = (shapely.get_coordinates(area) - np.asarray(field.corner, float)) / CELL_M
    assume((np.abs(edges - np.round(edges)) > 1e-4).all())  # in single precision a centre is on either side of an edge
    off = ~inside(area, np.asarray(field.corner, float), tuple(field.shape.tolist()), CELL_M)
    wanted = gaussian_filter(off.astype(np.float32), SIGMA_M / CELL_M, mode="nearest")
    assert np.asarray(field.cells)[: off.size, 0] == pytest.approx(wanted.ravel(), abs=1e-6)
