import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st
from jax.test_util import check_grads

from regents_cosim.geometry import boxes as host
from regents_cosim.mirror import separation
from regents_cosim.mirror.separation import Box, overlaps

# Compiled as a whole: op by op, every shape and precision would compile each of them alone.
distance, gap = jax.jit(separation.distance), jax.jit(separation.gap)


def device(box: host.Boxes) -> Box:
    values = (box.x, box.y, np.cos(box.yaw), np.sin(box.yaw), 0.5 * box.length, 0.5 * box.width)
    return Box(*(jnp.asarray(value) for value in values))


def random_boxes(n, seed, spread=6.0):
    rng = np.random.default_rng(seed)
    ranges = ((-spread, spread), (-spread, spread), (-4, 4), (0.5, 12), (0.3, 3))
    return host.Boxes(*(rng.uniform(low, high, n) for low, high in ranges))


def test_thousands_of_pairs_agree_with_shapely():
    a, b = random_boxes(5_000, 4), random_boxes(5_000, 5)
    polygons = [shapely.polygons(host.corners(box)) for box in (a, b)]
    exact = shapely.distance(*polygons)
    assert distance(device(a), device(b)) == pytest.approx(exact, abs=2e-5)
    clear = np.abs(np.asarray(gap(device(a), device(b)))) > 1e-5
    assert (np.asarray(overlaps(device(a), device(b)))[clear] == (exact == 0)[clear]).all()


@pytest.mark.parametrize(
    ("x", "y", "yaw", "length", "expected"),
    [
        (4.0, 0.0, 0.0, 4.0, 0.0),  # touching, end to end
        (0.0, 0.0, np.pi / 2, 10.0, 0.0),  # crossing like a plus sign, no corner inside either
        (0.0, 0.0, 0.3, 0.5, 0.0),  # contained
        (1.0, 3.5, 0.0, 4.0, 1.5),  # parallel, side by side
        (7.0, 6.0, 0.0, 4.0, 5.0),  # corner to corner: 3 along, 4 across
        (1000.0, 0.0, 0.0, 4.0, 996.0),  # far
        (4.0, 0.0, np.pi / 2, 4.0, 1.0),  # a side faces an end
    ],
)
def test_boxes_that_one_can_work_out(x, y, yaw, length, expected):
    fixed = device(host.Boxes(0.0, 0.0, 0.0, 4.0, 2.0))
    other = device(host.Boxes(x, y, yaw, length, 2.0 if length >= 4.0 else 0.5))
    assert float(distance(fixed, other)) == pytest.approx(expected, abs=1e-4)
    assert float(distance(other, fixed)) == pytest.approx(expected, abs=1e-4)


@given(st.integers(0, 2**31), st.floats(-50, 50), st.floats(-50, 50), st.floats(-4, 4))
def test_distances_do_not_depend_on_the_frame(x64, seed, x, y, turn):
    def moved(box):
        east, north = box.x * np.cos(turn) - box.y * np.sin(turn), box.x * np.sin(turn) + box.y * np.cos(turn)
        return device(box._replace(x=east + x, y=north + y, yaw=box.yaw + turn))

    a, b = random_boxes(50, seed), random_boxes(50, seed + 1)
    here = np.asarray(distance(device(a), device(b)))
    assert distance(moved(a), moved(b)) == pytest.approx(here, abs=1e-9)
    assert distance(device(b), device(a)) == pytest.approx(here, abs=1e-12)


def test_a_required_depth_makes_the_test_stricter():
    a, b = (device(host.Boxes(x, 0.0, 0.0, 4.0, 2.0)) for x in (0.0, 3.9))
    assert overlaps(a, b)
    assert overlaps(a, b, 0.05)
    assert not overlaps(a, b, 0.2)


@jax.jit
def distance_of(x, y, yaw):
    x, y, yaw = (jnp.asarray(value) for value in (x, y, yaw))
    moved = Box(x, y, jnp.cos(yaw), jnp.sin(yaw), jnp.asarray(2.0), jnp.asarray(1.0))
    return distance(device(host.Boxes(0.0, 0.0, 0.3, 5.0, 2.0)), moved)


slope = jax.jit(jax.grad(distance_of, (0, 1, 2)))


@settings(max_examples=40)
@example(16.0, 0.3359375, 0.59375)
@given(st.floats(4, 20), st.floats(-3, 3), st.floats(-3, 3))
def test_gradients_are_those_of_finite_differences(x64, radius, bearing, yaw):
    point = tuple(jnp.asarray(v) for v in (radius * np.cos(bearing), radius * np.sin(bearing), yaw))
    fixed, moved = host.Boxes(0.0, 0.0, 0.3, 5.0, 2.0), host.Boxes(*(float(v) for v in point), 4.0, 2.0)
    least, second = sorted([*corner_distances(fixed, moved), *corner_distances(moved, fixed)])[:2]
    if least > 0.01 and second > least + 2e-4:  # away from contact and from ties of corners, which share the gradient
        check_grads(distance_of, point, order=1, modes=["rev"], eps=1e-7, atol=1e-4, rtol=1e-4)


def corner_distances(box, other):
    return shapely.distance(shapely.polygons(host.corners(box)), shapely.points(host.corners(other)))


@pytest.mark.parametrize("x", [0.0, 1.0, 4.4, 4.5, 4.500001, 100.0])
@pytest.mark.parametrize("yaw", [0.0, np.pi / 2, 1.0])
def test_the_gradient_is_finite_everywhere(x, yaw):
    gradient = slope(jnp.float32(x), jnp.float32(0.0), jnp.float32(yaw))
    assert all(jnp.isfinite(value) for value in gradient)


def test_overlapping_boxes_have_no_gradient():
    assert [float(v) for v in jax.grad(distance_of, (0, 1))(jnp.float32(1.0), jnp.float32(0.5), jnp.float32(0.0))] == [
        0,
        0,
    ]
