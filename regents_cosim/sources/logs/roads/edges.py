"""Turns oriented kerbs into an area: everything to the left of the nearest kerb of the same height.

The points of the kerbs are triangulated. Every triangle lies on one side, because its sides are parts of kerbs or cross
the road from kerb to kerb; its middle tells on which. So the outline of the area consists of the kerbs themselves, not
of a raster.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Bool, Float
from scipy.spatial import Delaunay, KDTree, QhullError
from shapely.geometry.base import BaseGeometry

from regents_cosim.geometry.lines import distances_along, length_of, points_at, steps_along
from regents_cosim.sources.logs.scene import LoggedLane, RoadEdge

_SPACING_M = 1.0  # between points along kerbs; finer than any road is wide
_REACH_M = 30.0  # a place on the road is at most this far from the nearest kerb
_BESIDE_LANE_M = 15.0  # and at most this far from the nearest lane, where lanes are known
_LANE_SPACING_M = 2.0
_LEVEL_M = 2.5  # difference in height from which roads cross without meeting
_HEIGHT_STRETCH = 2.0  # weight of height against horizontal distance, so that a kerb above is not near
_LANE_NEAR_M = 12.0  # lanes within this distance tell the heights at a place
_ASIDE_M = 1e-3
_SHORTEST_M = 1e-3
_MOST_POINTS = 50_000  # larger maps are sampled more coarsely


class _Kerbs(NamedTuple):
    """Points along all kerbs."""

    points: Float[np.ndarray, "point 2"]  # [m]
    left: Float[np.ndarray, "point 2"]  # direction towards the road
    z: Float[np.ndarray, " point"]  # [m]


def area_inside(edges: Sequence[RoadEdge], lanes: Sequence[LoggedLane]) -> BaseGeometry:
    """The drivable area that `edges` enclose; empty where they enclose none.

    Where roads cross at different heights both are included, each bounded by its own kerbs.
    """
    kerbs = _along(edges)
    if len(kerbs.points) < 3:
        return shapely.Polygon()
    try:
        triangles = Delaunay(kerbs.points - kerbs.points.mean(axis=0)).simplices
    except QhullError:  # all on one line
        return shapely.Polygon()
    middle = kerbs.points[triangles].mean(axis=1)
    inside = _drivable(middle, kerbs, lanes)
    corners = kerbs.points[triangles[inside]]
    rings = np.asarray(shapely.polygons(np.concatenate([corners, corners[:, :1]], axis=1)))
    try:
        area = shapely.coverage_union_all(rings)  # 10 times as fast as `union_all`
    except shapely.errors.GEOSException:  # slivers do not have the exact common sides that it needs
        area = shapely.union_all(rings)
    return shapely.make_valid(area)


def _along(edges: Sequence[RoadEdge]) -> _Kerbs:
    lengths = [length_of(edge.points) for edge in edges]
    spacing = max(_SPACING_M, sum(lengths) / _MOST_POINTS)
    parts = [_dense(edge, spacing) for edge, length in zip(edges, lengths, strict=True) if length > _SHORTEST_M]
    if not parts:
        return _Kerbs(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))
    points, left, z = (np.concatenate(values) for values in zip(*parts, strict=True))
    thin = -(-len(points) // (2 * _MOST_POINTS))
    return _once(_Kerbs(points[::thin], left[::thin], z[::thin]))


def _once(kerbs: _Kerbs) -> _Kerbs:
    """The kerbs with one point per place and the sum of the directions: doubled points leave gaps between triangles."""
    _, first, number = np.unique(
        np.round(kerbs.points - kerbs.points.min(axis=0), 2), axis=0, return_index=True, return_inverse=True
    )
    left = np.zeros((len(first), 2))
    np.add.at(left, number.ravel(), kerbs.left)
    # Straight kerbs are full of points on one circle, over which Qhull takes quadratic time: 4.6 s for twice 5000
    # points, 0.06 s if they are a millimetre off.
    aside = np.random.default_rng(0).normal(0.0, _ASIDE_M, (len(first), 2))
    return _Kerbs(kerbs.points[first] + aside, left, kerbs.z[first])


def _dense(edge: RoadEdge, spacing: float) -> _Kerbs:
    """Points at most `spacing` [m] apart along a kerb, each with the summed left-hand normals of its two sides."""
    moved = np.concatenate([[True], steps_along(*edge.points.T) > _SHORTEST_M])
    moved[np.argmax(np.hypot(*(edge.points - edge.points[0]).T))] = True
    points = edge.points[moved]
    z = np.zeros(len(points)) if edge.z is None else edge.z[moved]
    way = distances_along(*points.T)
    at = np.union1d(way, np.linspace(0.0, way[-1], int(way[-1] / spacing) + 2))
    dense = points_at(at, way, points)
    along = np.diff(points, axis=0) / np.maximum(np.diff(way), _SHORTEST_M)[:, None]
    here = np.clip(np.searchsorted(way, at, side="right") - 1, 0, len(along) - 1)
    behind = np.clip(np.searchsorted(way, at, side="left") - 1, 0, len(along) - 1)
    both = along[here] + along[behind]
    return _Kerbs(dense, np.stack([-both[:, 1], both[:, 0]], axis=-1), np.interp(at, way, z))


def _drivable(
    places: Float[np.ndarray, "place 2"], kerbs: _Kerbs, lanes: Sequence[LoggedLane]
) -> Bool[np.ndarray, " place"]:
    near = np.ones(len(places), bool)
    if lanes:
        near = KDTree(_spaced(lanes)[:, :2]).query(places)[0] <= _BESIDE_LANE_M
    tree = KDTree(np.column_stack([kerbs.points, _HEIGHT_STRETCH * kerbs.z]))
    found = np.zeros(len(places), bool)
    for level in _levels(places, kerbs, lanes):
        away, index = tree.query(np.column_stack([places, _HEIGHT_STRETCH * level]))
        is_left = ((places - kerbs.points[index]) * kerbs.left[index]).sum(axis=1) > 0.0
        found |= is_left & (away <= _REACH_M)
    return found & near


def _spaced(lanes: Sequence[LoggedLane]) -> Float[np.ndarray, "point 3"]:
    """Points (x, y, z) along lanes, since a log may hold only their ends."""
    ways = [distances_along(*lane.centre.T) for lane in lanes]
    spacing = max(_LANE_SPACING_M, sum(float(way[-1]) for way in ways) / _MOST_POINTS)
    found = []
    for lane, way in zip(lanes, ways, strict=True):
        at = np.linspace(0.0, way[-1], int(way[-1] / spacing) + 2)
        z = np.zeros(len(way)) if lane.z is None else lane.z
        found.append(points_at(at, way, np.column_stack([lane.centre, z])))
    return np.concatenate(found)


def _levels(
    places: Float[np.ndarray, "place 2"], kerbs: _Kerbs, lanes: Sequence[LoggedLane]
) -> list[Float[np.ndarray, " place"]]:
    """The height of the road at every place, as one array per level: two where one road crosses above another."""
    nearest = kerbs.z[KDTree(kerbs.points).query(places)[1]]
    known = [lane for lane in lanes if lane.z is not None]
    if not known:
        return [nearest]
    points = _spaced(known)
    z = points[:, 2]
    count = min(16, len(points))
    away, index = KDTree(points[:, :2]).query(places, k=count, distance_upper_bound=_LANE_NEAR_M)
    heights = np.where(np.isfinite(away), np.append(z, 0.0)[index], np.nan)
    away, heights = (values.reshape(len(places), count) for values in (away, heights))
    there = np.isfinite(away[:, 0])
    lowest = np.where(there, np.nanmin(np.where(there[:, None], heights, 0.0), axis=1), nearest)
    highest = np.where(there, np.nanmax(np.where(there[:, None], heights, 0.0), axis=1), nearest)
    if (highest - lowest).max(initial=0.0) < _LEVEL_M:
        return [0.5 * (lowest + highest)]
    return [lowest, highest]
