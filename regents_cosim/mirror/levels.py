"""Roads above each other on the device: the level of a height, and the height of the road under an agent.

The rule is that of `regents_cosim.maps.levels.Heights` on the host, evaluated on a grid. Programs for scenes without
roads above each other contain no heights.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.geometry.rasters import grid_shape
from regents_cosim.maps.levels import BAND_M, Heights, band
from regents_cosim.mirror.lookup import look_up
from regents_cosim.mirror.programs.on_device import seen_from

CELL_M = 4.0  # a slope of 10 % rises by 0.2 m from the middle of a cell to its edge
_MARGIN_M = 60.0  # beyond the recorded ways
_BANDS = 64  # the most levels: 96 m from the lowest to the highest
_SIZES = tuple(2**power for power in (14, 16, 18, 20, 22))  # numbers of cells; few shapes need few compilations


class LevelBands(eqx.Module):
    """The levels of a scene, numbered from the lowest."""

    row: Int[Array, " band"]  # number of the nearest level that the scene has
    lowest: Int[Array, ""]  # as `maps.levels.band` counts

    def __call__(self, z: Float[Array, "*axes"]) -> Int[Array, "*axes"]:
        """The number of the level nearest to a height [m]."""
        index = band(z, jnp) - self.lowest
        return look_up(self.row, jnp.clip(index, 0, self.row.shape[0] - 1))


class HeightMap(eqx.Module):
    """The height of the road at any place, for the agents of a scene with levels."""

    x: Float[Array, "agent time"]  # [m] the recorded ways
    y: Float[Array, "agent time"]  # [m]
    z: Float[Array, "agent time"]  # [m]
    cells: Float[Array, " cell"]  # [m] heights, level by level and row by row
    shape: Int[Array, " 2"]  # rows, columns of one level
    corner: Float[Array, " 2"]  # [m] position of the first cell
    bands: LevelBands

    def __call__(self, x: Float[Array, "agent *time"], y: Float[Array, "agent *time"]) -> Float[Array, "agent *time"]:
        """Heights [m] of the road under all agents, over time or at one instant; without gradient."""
        found = jax.vmap(self._height)(self.x, self.y, self.z, x, y)
        return jax.lax.stop_gradient(found)

    def of_ego(self, x: Float[Array, "*time"], y: Float[Array, "*time"]) -> Float[Array, "*time"]:
        """Heights [m] of the road under the ego alone; without gradient."""
        return jax.lax.stop_gradient(self._height(self.x[0], self.y[0], self.z[0], x, y))

    def _height(self, way_x: Array, way_y: Array, way_z: Array, x: Array, y: Array) -> Array:
        away = (x[..., None] - way_x) ** 2 + (y[..., None] - way_y) ** 2
        own = look_up(way_z, jnp.argmin(away, axis=-1))
        place = jnp.stack([(y - self.corner[1]) / CELL_M, (x - self.corner[0]) / CELL_M])
        rows, columns = self.shape[0], self.shape[1]
        row, column = jnp.round(place).astype(jnp.int32)
        row, column = jnp.clip(row, 0, rows - 1), jnp.clip(column, 0, columns - 1)
        return look_up(self.cells, (self.bands(own) * rows + row) * columns + column)


def to_bands(levels: list[int]) -> LevelBands:
    """Put levels on the device, the lowest first; all levels more than 96 m above it count as one."""
    all_ = levels[0] + np.arange(_BANDS)
    nearest = np.abs(all_[:, None] - np.array(levels)).argmin(axis=1)
    return LevelBands(jnp.asarray(nearest, jnp.int32), jnp.int32(levels[0]))


def to_height_map(
    heights: Heights,
    way: tuple[Float[np.ndarray, "agent time"], Float[np.ndarray, "agent time"], Float[np.ndarray, "agent time"]],
    present: Bool[np.ndarray, "agent time"],
    origin: Float[np.ndarray, " 2"],
) -> HeightMap:
    """Put heights on the device in coordinates less `origin` [m]; `way` [m, map frame] is valid where `present`."""
    x, y, z = way
    low, high = (edge([x[present], y[present]], axis=1) for edge in (np.min, np.max))
    corner = low - _MARGIN_M
    rows, columns = grid_shape(corner, high + _MARGIN_M, CELL_M)
    places = corner + CELL_M * np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1)
    cells = np.stack([heights.surface(places, level * BAND_M) for level in heights.levels]).ravel()
    size = next((size for size in _SIZES if size >= cells.size), cells.size)
    here = seen_from(np.stack([x, y], axis=-1), origin)
    return HeightMap(
        *(jnp.asarray(values, jnp.float32) for values in (here[..., 0], here[..., 1], z)),
        cells=jnp.asarray(np.pad(cells, (0, size - cells.size)), jnp.float32),
        shape=jnp.array([rows, columns], jnp.int32),
        corner=jnp.asarray(seen_from(corner, origin), jnp.float32),
        bands=to_bands(heights.levels),
    )
