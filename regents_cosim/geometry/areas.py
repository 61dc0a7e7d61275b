"""Close gaps in areas that consist of strips."""

import shapely
from shapely.geometry.base import BaseGeometry

_ROUNDED = 1e-6  # share of the area that rounding may lose


def closed(area: BaseGeometry, gap_m: float) -> BaseGeometry:
    """`area` with gaps up to twice `gap_m` wide filled, its corners as sharp as before.

    Where parts nearly meet, GEOS may return edges that cross, which its later operations refuse, or may lose whole
    parts. Then the edges are repaired, and the original area is added again.
    """
    filled = area.buffer(gap_m, join_style="mitre").buffer(-gap_m, join_style="mitre")
    if filled.is_valid and filled.area >= (1.0 - _ROUNDED) * area.area:
        return filled
    return shapely.union(shapely.make_valid(filled, method="structure", keep_collapsed=False), area)
