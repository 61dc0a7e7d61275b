"""Limit how often the parts of a road may cross each other before they are united.

A thousand strips that all cross have a million crossings, for which GEOS takes hours. In real maps a strip meets only
the few before, behind and beside it.
"""

from collections.abc import Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from regents_cosim.errors import InputError

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
