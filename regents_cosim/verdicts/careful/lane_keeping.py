"""Tell whether an agent keeps to a lane in its direction, by the distance from the lanes' centre lines."""

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.geometry.boxes import same_level
from regents_cosim.geometry.frames import wrap
from regents_cosim.maps.levels import height_on
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.norms.limits import ALONG_RAD

_REACH_M = 2.0
_DIRECTION_M = 0.5  # length over which the direction of a lane is taken


def from_lane_centre(
    road: RoadMap,
    x: Float[np.ndarray, " place"],
    y: Float[np.ndarray, " place"],
    yaw: Float[np.ndarray, " place"],
    z: Float[np.ndarray, " place"],
) -> Float[np.ndarray, " place"]:
    """Distance [m] to the nearest centre line of a lane that runs within 45 degrees of `yaw`; infinite beyond 2 m."""
    found = np.full(len(x), np.inf)
    if not road.lanes or not len(x):
        return found
    where = np.asarray(shapely.points(x, y))
    place, lane = road.centre_lines.query(where, predicate="dwithin", distance=_REACH_M)
    line = road.centre_lines.geometries[lane]
    at = shapely.line_locate_point(line, where[place])
    at = np.clip(at, 0.0, np.maximum(shapely.length(line) - _DIRECTION_M, 0.0))
    begin, end = (
        shapely.get_coordinates(shapely.line_interpolate_point(line, at + ahead)) for ahead in (0.0, _DIRECTION_M)
    )
    turn = np.abs(wrap(np.arctan2(*(end - begin).T[::-1]) - yaw[place]))
    runs = turn < ALONG_RAD
    if road.raised:
        points = np.stack([x, y], axis=-1)
        at_level = [same_level(height_on(road.lanes[k], points[i]), z[i]) for i, k in zip(place, lane, strict=True)]
        runs &= np.array(at_level, bool)  # keeps the shape where there are no pairs
    np.minimum.at(found, place[runs], shapely.distance(line, where[place])[runs])
    return found
