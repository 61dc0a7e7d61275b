"""Areas of roads: close gaps between their strips, prepare them for threads, and bound the work of uniting them."""

from collections.abc import Sequence
from threading import Lock

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from regents_cosim.errors import InputError

_ROUNDED = 1e-6  # share of the area that rounding may lose


def closed(area: BaseGeometry, gap_m: float) -> BaseGeometry:
    """`area` with gaps up to twice `gap_m` wide filled, its corners as sharp as before.

    Where parts nearly meet, GEOS may return edges that cross, which its later operations refuse, or may lose whole
    parts. Then the edges are repaired, and the original area is added again, without the lines that this may leave.
    """
    filled = area.buffer(gap_m, join_style="mitre").buffer(-gap_m, join_style="mitre")
    if filled.is_valid and filled.area >= (1.0 - _ROUNDED) * area.area:
        return filled
    mended = shapely.union(shapely.make_valid(filled, method="structure", keep_collapsed=False), area)
    return shapely.union_all([part for part in shapely.get_parts(mended) if part.area])


# GEOS builds the index of a prepared geometry on the first query, without a lock: two threads that query first at the
# same time crash the process. Here one thread builds it before any other gets the area. Queries about lines and
# polygons (`covers`, `intersects` ...) are never safe in several threads: use a copy of the area for them.
_ONE_AT_A_TIME = Lock()


def prepared(area: BaseGeometry) -> BaseGeometry:
    """Return `area`, ready for `contains_xy` and `distance` of points from any thread."""
    with _ONE_AT_A_TIME:
        if not area.is_empty and not shapely.is_prepared(area):
            shapely.prepare(area)
            # The bounds alone answer for points far away, so these are points of the area; there are several because
            # the first is answered without an index.
            points = shapely.get_coordinates(area)[:8]
            shapely.contains_xy(area, *points.T)
            shapely.distance(area, shapely.points(points))
    return area


# A thousand strips that all cross have a million crossings, for which GEOS takes hours. In real maps a strip meets only
# the few before, behind and beside it.
_FEW = 20_000  # allowed meetings of two sides, and ...
_PER_SIDE = 30  # ... further ones per side: twice as many as the lanes of real junctions have
_AT_ONCE = 1 << 22  # the most meetings that one query may find


def require_few_crossings(parts: Sequence[BaseGeometry]) -> None:
    """Raise InputError where the sides of `parts` (lines or polygons) meet too often for a union."""
    corners, part = shapely.get_coordinates(np.asarray(parts, object), return_index=True)
    if len(corners) ** 2 <= _FEW:  # so few sides cannot exceed the limit
        return
    same = part[1:] == part[:-1]
    begin, end = corners[:-1][same], corners[1:][same]
    boxes = np.asarray(shapely.box(*np.minimum(begin, end).T, *np.maximum(begin, end).T))
    tree, most = shapely.STRtree(boxes), _FEW + _PER_SIDE * len(boxes)
    at_once, found = max(_AT_ONCE // len(boxes), 1), 0
    for first in range(0, len(boxes), at_once):
        found += tree.query(boxes[first : first + at_once]).shape[1]
        if found > most:
            raise InputError(
                f"the {len(boxes):,} sides of the road's parts cross each other more than {most:,} times (expected "
                "lanes that meet their neighbours)"
            )


def united(parts: Sequence[BaseGeometry]) -> BaseGeometry:
    """The union of parts of which any number may lie along each other, as the ways of vehicles on one road do.

    Raises InputError where a union of two parts, or of two such unions, exceeds the limit of `require_few_crossings`.
    """
    try:
        require_few_crossings(parts)
    except InputError:
        layer = list(parts)
    else:
        return shapely.union_all(parts)
    while len(layer) > 1:
        pairs = [layer[first : first + 2] for first in range(0, len(layer), 2)]
        for pair in pairs:
            require_few_crossings(pair)
        layer = [shapely.union_all(pair) for pair in pairs]
        _require_small(layer, len(shapely.get_coordinates(parts)))
    return layer[0]


def _require_small(layer: Sequence[BaseGeometry], corners: int) -> None:
    found = len(shapely.get_coordinates(layer))
    if found > _FEW + corners:
        raise InputError(
            f"the ways of vehicles have {corners:,} corners and cross each other in {found:,} places or more"
        )
