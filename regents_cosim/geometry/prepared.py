"""Areas that several threads may ask whether points are on them, and how far off.

GEOS makes the index of a prepared geometry when it is first asked, without a lock: two threads that ask first at the
same time crash the process. Here one thread makes it, before any other gets the area. To ask one about lines
and polygons (`covers`, `intersects` ...) is never safe in threads: for that, take a piece of the area of your own.
"""

from threading import Lock

import shapely
from shapely.geometry.base import BaseGeometry

_ONE_AT_A_TIME = Lock()


def prepared(area: BaseGeometry) -> BaseGeometry:
    """The same area, ready for `contains_xy` and `distance` of points from any thread."""
    with _ONE_AT_A_TIME:
        if not area.is_empty and not shapely.is_prepared(area):
            shapely.prepare(area)
            # Points of its own, as far ones are answered by the bounds alone; several, as the first is answered without
            # an index.
            points = shapely.get_coordinates(area)[:8]
            shapely.contains_xy(area, *points.T)
            shapely.distance(area, shapely.points(points))
    return area
