"""Roads above each other: the height of the road at a place, and the drivable area at a height.

Heights count only where roads lie above each other, or an agent drives over a road (`stacked`): hills alone separate no
agents. There a place is on one of the levels that are `BAND_M` apart, and a road belongs to a level if it is within the
clearance of it. So roads that are 3.8 m apart or more never mix.
"""

import functools
import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import shapely
from jaxtyping import Bool, Float
from shapely.geometry.base import BaseGeometry

from regents_cosim.geometry.areas import prepared
from regents_cosim.geometry.boxes import CLEARANCE_M, Values
from regents_cosim.geometry.lines import distances_along, points_at
from regents_cosim.maps.roadmap import Lane, RoadMap

BAND_M = 1.5
_SPACING_M = 1.0  # between the points that represent a surface
_MOST_POINTS = 50_000, 2_000_000  # of one lane, and of all lanes: beyond 50 km, or 2,000 km, points are further apart
_STRETCH = 3.0  # factor of heights: a road 8 m above counts as far away as one 24 m to the side
_REACH_M = 150.0  # beyond the tracks of a scene
_CELL_M = 4.0  # size of the cells that are compared, with their neighbours, to find roads above each other
# within this distance of such a cell a place belongs to a level; farther away every agent on a road is on its level
_AROUND_M = 15.0
_SEAM_M = 0.25  # half the greatest width of gaps between lanes that are closed

Points = Float[np.ndarray, "point 3"]


def band(z: Any, xp: Any = np) -> Any:
    """The number of the level nearest to a height [m]; `xp` is NumPy or jax.numpy."""
    return xp.round(z / BAND_M).astype(int)


def surface_points(lanes: tuple[Lane, ...] | list[Lane]) -> Points:
    """Points (x, y, z) [m] along the centre lines of lanes, at most a metre apart."""
    spacing_m = _spacing_m(lanes)
    return np.concatenate([np.zeros((0, 3)), *(_dense(lane, spacing_m) for lane in lanes)])


def stacked(points: Points) -> Bool[np.ndarray, " point"]:
    """Which points lie above or below others by the clearance or more."""
    found = np.zeros(len(points), bool)
    if not len(points) or np.ptp(points[:, 2]) < CLEARANCE_M:
        return found
    cell = np.floor((points[:, :2] - points[:, :2].min(axis=0)) / _CELL_M).astype(np.int64) + 1
    row = int(cell[:, 1].max()) + 2
    cells, index = np.unique(cell[:, 0] * row + cell[:, 1], return_inverse=True)
    low, high = np.full(len(cells), np.inf), np.full(len(cells), -np.inf)
    np.minimum.at(low, index, points[:, 2])
    np.maximum.at(high, index, points[:, 2])
    for shift in (across * row + along for across in (-1, 0, 1) for along in (-1, 0, 1)):
        at = np.minimum(np.searchsorted(cells, cells + shift), len(cells) - 1)
        apart = np.maximum((high - low[at])[index], (high[at] - low)[index])
        found |= (cells[at] == cells + shift)[index] & (apart >= CLEARANCE_M)
    return found


# --- where one may drive ------------------------------------------------------------------------


@functools.lru_cache(maxsize=16)
def has_levels(road: RoadMap) -> bool:
    """Whether lanes of the map lie above each other."""
    return not _crossings(road).is_empty


@functools.lru_cache(maxsize=16)
def _crossings(road: RoadMap) -> BaseGeometry:
    """The places where lanes lie above each other, with their surroundings."""
    points = surface_points(road.lanes) if road.raised else np.zeros((0, 3))
    points = points[stacked(points), :2]
    # keeps the result the same wherever the map lies
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0)) if len(points) else np.zeros(2)
    places = np.unique(np.round((points - middle) / _CELL_M), axis=0) * _CELL_M + middle
    return shapely.union_all(shapely.buffer(shapely.points(places), _AROUND_M, quad_segs=2))


def drivable_at(road: RoadMap, z: float) -> BaseGeometry:
    """The drivable area at a height [m]: the map's area, less the lanes of other levels where lanes cross."""
    return _drivable_of(road, int(band(z))) if has_levels(road) else road.drivable


def contains(road: RoadMap, points: Float[np.ndarray, "... 2"], z: Values) -> Bool[np.ndarray, "..."]:
    """Whether points [m] at heights `z` [m] lie on the drivable area of their level."""
    if not has_levels(road):
        return road.contains(points)
    bands = np.broadcast_to(band(z), points.shape[:-1])
    found = np.zeros(bands.shape, bool)
    for one in np.unique(bands).tolist():
        here = bands == one
        found[here] = shapely.contains_xy(_drivable_of(road, one), *points[here].T)
    return found


def beyond_road(road: RoadMap, points: Float[np.ndarray, "... 2"], z: Values) -> Float[np.ndarray, "..."]:
    """Distance [m] of points [m] at heights `z` [m] from the drivable area of their level; 0 inside."""
    found = np.zeros(points.shape[:-1])
    away, bands = ~contains(road, points, z), band(z) if has_levels(road) else 0
    for one in np.unique(bands).tolist():
        here = away & (bands == one)
        found[here] = shapely.distance(drivable_at(road, one * BAND_M), shapely.points(points[here]))
    return found


def height_on(lane: Lane, points: Float[np.ndarray, "... 2"]) -> Float[np.ndarray, "..."]:
    """The height [m] of a lane at its points nearest to `points` [m]."""
    if not lane.height.any():
        return np.zeros(points.shape[:-1])
    line = lane.line
    at = shapely.line_locate_point(line, shapely.points(points))
    along = distances_along(*lane.centre.T)
    return np.asarray(np.interp(at, along, lane.height))


@functools.lru_cache(maxsize=64)
def _drivable_of(road: RoadMap, level: int) -> BaseGeometry:
    crossings = _crossings(road)
    near = road.centre_lines.query(crossings, predicate="dwithin", distance=_AROUND_M)
    lanes = [lane for index in near if (lane := road.lanes[index]).length]
    spacing_m = _spacing_m(lanes)
    pieces = [piece for lane in lanes for piece in _pieces(lane, level * BAND_M, spacing_m)]
    own = shapely.union_all([strip for strip, is_own in pieces if is_own])
    others = shapely.union_all([strip for strip, is_own in pieces if not is_own])
    taken = shapely.difference(shapely.intersection(others.buffer(_SEAM_M, join_style="mitre"), crossings), own)
    return prepared(shapely.difference(road.drivable, taken))


def _pieces(lane: Lane, z: float, spacing_m: float) -> Iterator[tuple[BaseGeometry, bool]]:
    """The strips of a lane, each with whether it is within the clearance of height `z` [m]."""
    points = _dense(lane, spacing_m)
    own = np.abs(points[:, 2] - z) < CLEARANCE_M
    ends = [0, *(np.flatnonzero(np.diff(own)) + 1).tolist(), len(points)]
    for begin, end in itertools.pairwise(ends):
        line = shapely.LineString(points[max(begin - 1, 0) : end + 1, :2])
        yield line.buffer(0.5 * lane.width, cap_style="flat"), bool(own[begin])


def _spacing_m(lanes: Sequence[Lane]) -> float:
    """The distance [m] between points along lanes."""
    return max(_SPACING_M, sum(lane.length for lane in lanes) / _MOST_POINTS[1])


def _dense(lane: Lane, spacing_m: float) -> Points:
    along = distances_along(*lane.centre.T)
    count = min(int(along[-1] / spacing_m) + 2, _MOST_POINTS[0])
    at = np.union1d(along, np.linspace(0.0, along[-1], count))
    return points_at(at, along, np.column_stack([lane.centre, lane.height]))


# --- how high the road is -----------------------------------------------------------------------


class Heights:
    """The height of the road under the agents of one scene, at any place.

    An agent that leaves its recorded way stays on the surface that continues it: of the surfaces at its place, the one
    nearest to the height of its recorded way at the nearest point. So it is taken for an agent on another road only if
    it climbs or falls by half the distance between two roads after its recording ends or its way parts.
    """

    def __init__(
        self,
        road: RoadMap,
        x: Float[np.ndarray, "agent time"],
        y: Float[np.ndarray, "agent time"],
        z: Float[np.ndarray, "agent time"],
        valid: Bool[np.ndarray, "agent time"],
    ) -> None:
        """`x`, `y` and `z` [m] are the recorded ways."""
        self.flat = not (road.raised or z.any())
        self._way, self._valid = np.stack([x, y, z], axis=-1), valid
        if not self.flat:
            way = self._way[valid]
            low, high = way[:, :2].min(axis=0) - _REACH_M, way[:, :2].max(axis=0) + _REACH_M
            near = road.centre_lines.query(shapely.box(*low, *high))
            self.points = np.concatenate([surface_points([road.lanes[index] for index in near]), way])

    @functools.cached_property
    def stacked(self) -> bool:
        """Whether surfaces lie above each other around the recorded ways."""
        return bool(self.levels)

    @functools.cached_property
    def levels(self) -> list[int]:
        """The levels of surfaces that lie above each other, the lowest first."""
        return [] if self.flat else np.unique(band(self.points[stacked(self.points), 2])).tolist()

    def __call__(
        self, x: Float[np.ndarray, "agent *axes"], y: Float[np.ndarray, "agent *axes"]
    ) -> Float[np.ndarray, "agent *axes"]:
        """Heights [m] of the road under all agents at the given places [m]."""
        if self.flat:
            return np.zeros(x.shape)
        rows = (slice(agent, agent + 1) for agent in range(len(x)))
        return np.concatenate([self.of(row.start, x[row], y[row]) for row in rows])

    def of(
        self, agent: int, x: Float[np.ndarray, "*axes"], y: Float[np.ndarray, "*axes"]
    ) -> Float[np.ndarray, "*axes"]:
        """Heights [m] of the road under one agent at the given places [m]."""
        there = self._valid[agent]
        if self.flat or not there.any():
            return np.zeros(np.shape(x))
        way, place = self._way[agent, there], np.stack([x, y], axis=-1)
        _, nearest = _tree_of(way[:, :2]).query(place)
        return self.surface(place, way[nearest, 2])

    def surface(self, place: Float[np.ndarray, "... 2"], z: Values) -> Float[np.ndarray, "..."]:
        """The heights [m] of those surfaces at `place` [m] that are nearest to the heights `z` [m]."""
        stretched = np.concatenate([place, np.broadcast_to(z, place.shape[:-1])[..., None] * _STRETCH], axis=-1)
        return np.asarray(self.points[self._tree.query(stretched)[1], 2])

    @functools.cached_property
    def _tree(self) -> Any:
        return _tree_of(self.points * [1.0, 1.0, _STRETCH])


def _tree_of(points: Float[np.ndarray, "point axes"]) -> Any:
    """A `scipy.spatial.KDTree`; SciPy is imported only for roads above each other, as the import is slow."""
    from scipy.spatial import KDTree

    return KDTree(points)
