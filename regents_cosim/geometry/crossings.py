"""How often parts of a road cross each other: what putting them together takes.

A thousand strips that all cross have a million crossings, for which GEOS takes hours. Real maps have a few a side: a
strip meets those before, behind and beside it.
"""

from collections.abc import Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from regents_cosim.errors import InputError

_FEW = 20_000  # meetings of two sides, and ...
_PER_SIDE = 30  # ... so many more for each side: twice what the lanes of real junctions have
_AT_ONCE = 1 << 22  # meetings that may be found in one go


def require_few_crossings(parts: Sequence[BaseGeometry]) -> None:
    """Raise InputError where the sides of `parts`, lines or polygons, meet too often for putting them together."""
    corners, part = shapely.get_coordinates(np.asarray(parts, object), return_index=True)
    if len(corners) ** 2 <= _FEW:  # wherever they lie
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
    """The union of parts that may lie along each other in any number, as the ways of vehicles over one road do.

    Raises InputError as `require_few_crossings` does, of what two and two of them come to.
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
