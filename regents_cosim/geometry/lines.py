"""Where lines lead."""

import numpy as np
import shapely

_HALF_M = 0.5  # to each side of a place: the direction of a line is that of a metre of it


def heading_near(line: shapely.LineString, place: shapely.Point) -> float:
    """The direction [rad] of a line over the metre around its point nearest to `place`, less where the line ends."""
    at = min(max(float(line.project(place)), _HALF_M), max(line.length - _HALF_M, 0.0))
    (x0, y0), (x1, y1) = shapely.get_coordinates(
        shapely.line_interpolate_point(line, [max(at - _HALF_M, 0.0), min(at + _HALF_M, line.length)])
    )
    return float(np.arctan2(y1 - y0, x1 - x0))
