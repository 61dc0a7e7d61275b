"""The road field: the non-drivable area, blurred, on a grid; it tells how far a point is off the road.

The ReGentS paper convolves a binary map with a Gaussian at every corner of every box. Blurring the map once and
interpolating bilinearly gives the same number, and is far cheaper.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from threading import Lock

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import shapely
from jaxtyping import Array, Float, Int
from shapely.geometry.base import BaseGeometry

from regents_cosim.geometry.rasters import grid_shape, inside
from regents_cosim.maps.levels import BAND_M, drivable_at
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.mirror.levels import LevelBands, to_bands
from regents_cosim.mirror.lookup import look_up
from regents_cosim.mirror.programs.on_device import empty_for_device, handed_over, on_device, seen_from

CELL_M = 0.2  # at 0.5 m the gradient is off by up to 24 %, at 0.2 m by 10 % (sigma 0.5 m)
SIGMA_M = 0.5
_OFFSET_M = 7e-4  # offset of the cell centres from the odd tenths of a metre
_ROUNDING = 1e-6  # of a cell: keeps whole numbers of cells whole wherever they lie
MARGIN_M = 12.0  # how far the field reaches beyond the tracks; it is constant outside
_SIZES = tuple(2**power for power in (18, 20, 22, 24))  # numbers of cells; few shapes need few compilations
_ROWS_AT_ONCE = 32  # rows that are blurred at once: so many stay in the cache
ROOM = 2**20  # cells: 200 m x 200 m, enough around an ego in nearly every scene
_turn = Lock()


class RoadField(eqx.Module):
    """The blurred non-drivable map in scene coordinates; cells also hold their neighbours, for one gather per look-up.

    Cell (r, c), number r * columns + c, holds the values at (r, c), (r, c+1), (r+1, c) and (r+1, c+1); row 0 is at the
    least y. Cells beyond rows * columns are padding. Where roads lie above each other, the cells of one level follow
    those of another.
    """

    cells: Float[Array, "cell 4"]  # 0 on the road, 1 off it
    shape: Int[Array, " 2"]  # rows, columns
    corner: Float[Array, " 2"]  # [m] position of cell (0, 0)
    bands: LevelBands | None = None  # the levels, if roads lie above each other

    def __call__(
        self, x: Float[Array, "*axes"], y: Float[Array, "*axes"], z: Float[Array, "*#axes"] | None = None
    ) -> Float[Array, "*axes"]:
        """The field at points [m], bilinear between cells and constant beyond the border of the grid.

        Heights `z` [m] choose the level. The field is differentiable with respect to the points alone.
        """
        return _look_up(self, x, y, z)

    def seen_from(self, origin: Float[np.ndarray, " 2"]) -> "RoadField":
        """The field in coordinates relative to `origin` [m]."""
        return replace(self, corner=on_device(seen_from(np.asarray(self.corner, float), origin), np.float32))


def all_road() -> RoadField:
    """The field of a scene that is road everywhere, for programs that do not use the road; it takes no time to make."""
    return RoadField(
        on_device(np.zeros((1, 4)), np.float32), on_device(np.ones(2), np.int32), on_device(np.zeros(2), np.float32)
    )


@jax.custom_jvp
def _look_up(
    field: RoadField, x: Float[Array, "*axes"], y: Float[Array, "*axes"], z: Float[Array, "*#axes"] | None
) -> Float[Array, "*axes"]:
    return _value_and_slope(field, x, y, z)[0]


@_look_up.defjvp
def _look_up_jvp(
    at: tuple[RoadField, Array, Array, Array | None], moved: tuple[RoadField, Array, Array, Array | None]
) -> tuple[Array, Array]:
    """The derivative by hand: that of JAX would read the neighbours of every corner of every box once more."""
    value, east, north = _value_and_slope(*at)
    return value, east * moved[1] + north * moved[2]


def _value_and_slope(field: RoadField, x: Array, y: Array, z: Array | None) -> tuple[Array, Array, Array]:
    """The field, and its slopes along x and y [1/m]."""
    rows, columns = field.shape
    u, v = (x - field.corner[0]) / CELL_M, (y - field.corner[1]) / CELL_M
    beside, beyond = (u < 0.0) | (u > columns - 1.001), (v < 0.0) | (v > rows - 1.001)
    u, v = jnp.clip(u, 0.0, columns - 1.001), jnp.clip(v, 0.0, rows - 1.001)
    column, row = u.astype(jnp.int32), v.astype(jnp.int32)
    first = 0 if field.bands is None or z is None else field.bands(z) * rows
    near = look_up(field.cells, (first + row) * columns + column)
    s, t = u - column, v - row
    on_lower, on_upper = near[..., 1] - near[..., 0], near[..., 3] - near[..., 2]
    lower, upper = near[..., 0] + on_lower * s, near[..., 2] + on_upper * s
    across = upper - lower
    east = jnp.where(beside, 0.0, on_lower + (on_upper - on_lower) * t) / CELL_M
    return lower + across * t, east, jnp.where(beyond, 0.0, across) / CELL_M


def blur(
    road: RoadMap,
    low: Float[np.ndarray, " 2"],
    high: Float[np.ndarray, " 2"],
    origin: Float[np.ndarray, " 2"],
    levels: list[int] | None = None,
) -> RoadField:
    """The field of `road` over the bounds `low`..`high` [m, map frame] plus a margin, for each of `levels` if given.

    Where the whole road takes no more cells, the field covers the whole road and is shared by all scenes on it.
    Coordinates of the result are relative to `origin` [m]. Raises ScenarioError for bounds that are too far apart.

    Source: C_adv_dev of the ReGentS paper (m_oob * K), with K a Gaussian of sigma 0.5 m.
    """
    low, high = low - MARGIN_M, high + MARGIN_M
    grid_shape(low, high, CELL_M)  # raises
    if levels is not None:
        areas = [drivable_at(road, level * BAND_M) for level in levels]
        return blur_areas(areas, low, high, origin, to_bands(levels))
    least, most = _around(road)
    if _room_for(_cells(least, most)) <= _room_for(_cells(low, high)):
        with _turn:  # several scenes may ask for it at the same time
            return _of_all(road).seen_from(origin - least)
    return blur_areas([road.drivable], low, high, origin)


def _around(road: RoadMap) -> tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]]:
    """The bounds [m, map frame] of a road with a margin."""
    bounds = np.array(road.drivable.bounds)
    return bounds[:2] - MARGIN_M, bounds[2:] + MARGIN_M


@lru_cache(maxsize=2)
def _of_all(road: RoadMap) -> RoadField:
    """The field of the whole road, in coordinates that begin at its lower bounds."""
    least, most = _around(road)
    return blur_areas([road.drivable], least, most, least)


def _cells(low: Float[np.ndarray, " 2"], high: Float[np.ndarray, " 2"]) -> int:
    """The approximate number of cells between bounds [m]."""
    return int(np.prod(np.ceil((high - low) / CELL_M) + 1.0))


def _room_for(cells: int) -> int:
    """The number of cells that are allocated for a field of `cells` cells."""
    return next((size for size in _SIZES if size >= cells), cells)


def blur_areas(
    areas: Sequence[BaseGeometry],
    low: Float[np.ndarray, " 2"],
    high: Float[np.ndarray, " 2"],
    origin: Float[np.ndarray, " 2"],
    bands: LevelBands | None = None,
    room: int = 0,
    open_ended: bool = False,
) -> RoadField:
    """The field of drivable areas, one for each level, over the bounds `low`..`high` [m, map frame].

    At least `room` cells are allocated. With `open_ended` everything beyond the bounds counts as road.
    """
    # Cells begin at the corner of the areas, so that a field is the same wherever the areas lie. Centres lie near odd
    # tenths of a metre from there: edges of lanes lie at even ones (a width of 3.2 m) and would tie; edges at odd ones
    # would tie with centres exactly there.
    corner = shapely.total_bounds(np.asarray(areas))[:2]
    low = corner + (np.floor((low - corner) / CELL_M + _ROUNDING) + 0.5) * CELL_M + _OFFSET_M
    rows, columns = grid_shape(low, high, CELL_M)
    off_road = (~inside(area, low, (rows, columns), CELL_M) for area in areas)
    field = np.stack([_blurred(_blurred(off.astype(np.float32)).T).T for off in off_road])
    if open_ended:  # the field beyond the border has the value of the border
        field[:, [0, -1]] = field[:, :, [0, -1]] = 0.0
    return RoadField(
        handed_over(_with_neighbours(field, _room_for(max(field.size, room)))),
        on_device([rows, columns], np.int32),
        on_device(seen_from(low, origin), np.float32),
        bands,
    )


def _blurred(rows: Float[np.ndarray, "row column"]) -> Float[np.ndarray, "row column"]:
    """Convolve along columns with the Gaussian, cut off at four sigmas; the border is continued outwards.

    SciPy's `gaussian_filter` does not exploit that most columns are constant, and takes long to import.
    """
    reach = int(4.0 * SIGMA_M / CELL_M + 0.5)
    weight = np.exp(-0.5 * (np.arange(reach + 1) * CELL_M / SIGMA_M) ** 2)
    weight = (weight / (2.0 * weight.sum() - weight[0])).astype(np.float32)
    around, result = np.pad(rows, ((reach, reach), (0, 0)), mode="edge"), rows.copy(order="C")
    for first in range(0, len(rows), _ROWS_AT_ONCE):
        count = len(result[first : first + _ROWS_AT_ONCE])
        near = around[first : first + count + 2 * reach]
        changing = np.flatnonzero((near != near[0]).any(axis=0))
        lines = near[:, changing]
        blurred = weight[0] * lines[reach : reach + count]
        for off in range(1, reach + 1):
            blurred += weight[off] * (lines[reach - off :][:count] + lines[reach + off :][:count])
        result[first : first + count, changing] = blurred
    return result


def _with_neighbours(field: Float[np.ndarray, "level row column"], size: int) -> Float[np.ndarray, "size 4"]:
    """Each cell with those to its right, above it, and both; neighbours beyond the border are never read.

    It runs on the host: on CPUs XLA gathers one cell after the other, in five times the time.
    """
    cells, flat, columns = empty_for_device((size, 4), np.float32), field.ravel(), field.shape[2]
    for place, shift in enumerate((0, 1, columns, columns + 1)):
        cells[: flat.size - shift, place] = flat[shift:]
        cells[flat.size - shift : flat.size, place] = 0.0
    return cells
