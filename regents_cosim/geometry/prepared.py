"""Prepare areas so that several threads may ask whether points are inside, and how far away they are.

GEOS builds the index of a prepared geometry on the first query, without a lock: two threads that query first at the
same time crash the process. Here one thread builds it before any other gets the area. Queries about lines and polygons
(`covers`, `intersects` ...) are never safe in several threads: use a copy of the area for them.
"""

from threading import Lock

import shapely
from shapely.geometry.base import BaseGeometry

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
