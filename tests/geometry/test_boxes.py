from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from regents_cosim.geometry.boxes import (
    CLEARANCE_M,
    Boxes,
    Turned,
    corner_places,
    corners,
    distance,
    gap,
    overlap,
    same_level,
    square_apart,
)

BOX = st.builds(
    Boxes,
    x=st.floats(-6, 6),
    y=st.floats(-6, 6),
    yaw=st.floats(-7, 7),
    length=st.floats(0.5, 12),
    width=st.floats(0.3, 3),
    z=st.just(0.0),
)
HEIGHT = st.floats(-20, 20)


def polygon(box: Boxes) -> shapely.Polygon:
    return shapely.Polygon(corners(box))


@given(BOX, BOX)
def test_distance_is_shapelys(a, b):
    assert distance(a, b) == pytest.approx(polygon(a).distance(polygon(b)), abs=1e-9)


@given(BOX, BOX)
def test_overlap_holds_where_the_distance_is_zero(a, b):
    apart = polygon(a).distance(polygon(b))
    if not 0 < apart < 1e-9:  # nothing decides in the last bit
        assert overlap(a, b) == (apart == 0)


@given(BOX, BOX, st.floats(-4, 4), st.floats(-50, 50))
def test_distance_is_symmetric_and_does_not_change_when_both_move(a, b, turn, shift):
    def moved(box):
        point = (box.x + 1j * box.y) * np.exp(1j * turn) + shift
        return Boxes(point.real, point.imag, box.yaw + turn, box.length, box.width)

    assert distance(a, b) == pytest.approx(distance(b, a), abs=1e-9)
    assert distance(a, b) == pytest.approx(distance(moved(a), moved(b)), abs=1e-9)


@given(BOX, BOX, HEIGHT, HEIGHT)
def test_boxes_meet_on_one_level_only(a, b, low, high):
    raised = a._replace(z=low), b._replace(z=high)
    if abs(low - high) < CLEARANCE_M:
        assert overlap(*raised) == overlap(a, b)
        assert distance(*raised) == distance(a, b)
    else:
        assert not overlap(*raised)
        assert distance(*raised) == np.inf


def test_boxes_that_cross_like_a_plus_sign_overlap():
    flat, upright = Boxes(0.0, 0.0, 0.0, 6.0, 1.0), Boxes(0.0, 0.0, np.pi / 2, 6.0, 1.0)
    assert overlap(flat, upright)
    assert distance(flat, upright) == 0


def test_touching_counts_as_overlapping():
    assert overlap(Boxes(0.0, 0.0, 0.0, 4.0, 2.0), Boxes(4.0, 0.0, 0.0, 4.0, 2.0))
    assert not overlap(Boxes(0.0, 0.0, 0.0, 4.0, 2.0), Boxes(4.0 + 1e-9, 0.0, 0.0, 4.0, 2.0))


def test_corners_run_from_front_left_to_rear_left():
    found = corners(Boxes(10.0, 0.0, np.pi / 2, 4.0, 2.0))
    assert found == pytest.approx(np.array([[9, 2], [11, 2], [11, -2], [9, -2]]))


def test_fields_broadcast():
    one = Boxes(0.0, 0.0, 0.0, 4.0, 2.0)
    many = Boxes(np.array([[0.0], [9.0]]), np.zeros((2, 3)), np.zeros(3), 4.0, 2.0)
    assert distance(one, many).shape == (2, 3)
    assert distance(one, many)[1] == pytest.approx([5, 5, 5])


@pytest.mark.parametrize(("xp", "exact_m"), [(np, 1e-9), (jnp, 2e-5)], ids=["numpy", "jax"])
def test_the_geometry_is_shapelys_on_the_host_and_on_the_device(xp, exact_m):
    rng = np.random.default_rng(2)
    ranges = ((-6, 6), (-6, 6), (-4, 4), (0.5, 12), (0.3, 3))
    x, y, yaw, length, width = (rng.uniform(low, high, (2, 5_000)) for low, high in ranges)
    fields = (xp.asarray(v) for v in (x, y, np.cos(yaw), np.sin(yaw), 0.5 * length, 0.5 * width))
    a, b = (Turned(*pair) for pair in zip(*fields, strict=True))
    compiled = jax.jit if xp is jnp else lambda function: function
    places = [np.asarray(compiled(partial(corner_places, xp))(one)) for one in (a, b)]
    for at, found in enumerate(places):
        way = (x + 1j * y)[at] + np.exp(1j * yaw[at]) * (0.5 * length[at] + 0.5j * width[at])  # front left
        assert found[0, 0] + 1j * found[1, 0] == pytest.approx(way, abs=exact_m)
    polygons = [shapely.polygons(np.moveaxis(found, 0, -1).swapaxes(0, 1)) for found in places]
    apart = shapely.distance(*polygons)
    bound, square = (np.asarray(compiled(partial(function, xp))(a, b)) for function in (gap, square_apart))
    assert (bound <= apart + exact_m).all()
    clear = np.abs(bound) > exact_m
    assert ((bound <= 0.0) == (apart == 0.0))[clear].all()
    assert np.sqrt(square)[apart > 0.0] == pytest.approx(apart[apart > 0.0], abs=exact_m)
    assert 0.1 < (bound <= 0.0).mean() < 0.9


@pytest.mark.parametrize("xp", [np, jnp], ids=["numpy", "jax"])
def test_a_bridge_is_on_another_level_and_a_flat_scene_on_one(xp):
    low, high = xp.asarray([0.0, 0.0, 2.0]), xp.asarray([2.9, 3.0, -1.5])
    assert same_level(low, high).tolist() == [True, False, False]
    assert same_level(low, None) is True
