"""Where lines lead."""

import numpy as np
import shapely
from jaxtyping import Float

_HALF_M = 0.5  # to each side of a place: the direction of a line is that of a metre of it


def heading_near(line: shapely.LineString, place: shapely.Point) -> float:
    """The direction [rad] of a line over the metre around its point nearest to `place`, less where the line ends."""
    at = min(max(float(line.project(place)), _HALF_M), max(line.length - _HALF_M, 0.0))
    (x0, y0), (x1, y1) = shapely.get_coordinates(
        shapely.line_interpolate_point(line, [max(at - _HALF_M, 0.0), min(at + _HALF_M, line.length)])
    )
    return float(np.arctan2(y1 - y0, x1 - x0))


def stretch(
    points: Float[np.ndarray, "point 2"], begin_m: float, end_m: float = np.inf
) -> Float[np.ndarray, "fewer 2"]:
    """A line [m] between two distances along it; beyond its end that end, twice.

    As `shapely.ops.substring`, which takes a hundred times as long where the points are close to each other.
    """
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    begin, end = np.clip([begin_m, end_m], 0.0, along[-1])
    inside = points[(along > begin) & (along < end)]
    first, last = np.stack([np.interp([begin, end], along, values) for values in points.T], axis=1)
    return np.vstack([first, inside, last])
