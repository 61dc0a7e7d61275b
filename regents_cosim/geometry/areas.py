"""Areas put together from strips that leave gaps between them."""

import shapely
from shapely.geometry.base import BaseGeometry

_ROUNDED = 1e-6  # of the area: what is lost by rounding


def closed(area: BaseGeometry, gap_m: float) -> BaseGeometry:
    """The area with gaps of twice `gap_m` filled, its corners as sharp as before.

    Where parts nearly meet, GEOS may return edges that cross, with which it refuses to go on, or lose whole parts. Then
    edges are mended, and what was there stays there.
    """
    filled = area.buffer(gap_m, join_style="mitre").buffer(-gap_m, join_style="mitre")
    if filled.is_valid and filled.area >= (1.0 - _ROUNDED) * area.area:
        return filled
    return shapely.union(shapely.make_valid(filled, method="structure", keep_collapsed=False), area)
