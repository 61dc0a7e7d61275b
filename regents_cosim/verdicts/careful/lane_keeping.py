"""Where agents are in the lanes of their direction: how far from the middle, and from a line where they wait."""

from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Float, Int

from regents_cosim.geometry.boxes import same_level
from regents_cosim.geometry.frames import wrap
from regents_cosim.maps.levels import height_on
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.norms.limits import ALONG_RAD
from regents_cosim.routes.yield_lines import yield_lines
from regents_cosim.scenario.scenario import Scenario

_REACH_M = 2.0
_DIRECTION_M = 0.5  # length over which the direction of a lane is taken

_OfPlaces = Float[np.ndarray, " place"]


def from_lane_centre(road: RoadMap, x: _OfPlaces, y: _OfPlaces, yaw: _OfPlaces, z: _OfPlaces) -> _OfPlaces:
    """Distance [m] to the nearest centre line of a lane that runs within 45 degrees of `yaw`; infinite beyond 2 m.

    It is positive to the left of that line, and negative to its right.
    """
    found = np.full(len(x), np.inf)
    near = _lanes_near(road, x, y, yaw, z)
    order = np.lexsort((np.abs(near.off), near.place))
    place, first = np.unique(near.place[order], return_index=True)
    found[place] = near.off[order][first]
    return found


def to_yield_line(scenario: Scenario, x: _OfPlaces, y: _OfPlaces, yaw: _OfPlaces, z: _OfPlaces) -> _OfPlaces:
    """Distance [m] along the lane to the line at which others have to let the ego pass; 0 where there is none."""
    found, lines = np.zeros(len(x)), yield_lines(scenario)
    if not lines:
        return found
    near = _lanes_near(scenario.road, x, y, yaw, z)
    beyond = np.array([lines.get(lane.id, -np.inf) for lane in scenario.road.lanes])
    np.maximum.at(found, near.place, near.left + beyond[near.lane])
    return found


class _LanesNear(NamedTuple):
    """Pairs of a place and a lane within 2 m and 45 degrees of it."""

    place: Int[np.ndarray, " pair"]
    lane: Int[np.ndarray, " pair"]
    off: Float[np.ndarray, " pair"]  # [m] from the centre line, positive to its left
    left: Float[np.ndarray, " pair"]  # [m] along it to its end; negative beyond


def _lanes_near(road: RoadMap, x: _OfPlaces, y: _OfPlaces, yaw: _OfPlaces, z: _OfPlaces) -> _LanesNear:
    if not road.lanes or not len(x):
        return _LanesNear(*np.zeros((2, 0), int), *np.zeros((2, 0)))
    where = np.asarray(shapely.points(x, y))
    place, lane = road.centre_lines.query(where, predicate="dwithin", distance=_REACH_M)
    line = road.centre_lines.geometries[lane]
    length = shapely.length(line)
    at = np.clip(shapely.line_locate_point(line, where[place]), 0.0, np.maximum(length - _DIRECTION_M, 0.0))
    begin, end = (
        shapely.get_coordinates(shapely.line_interpolate_point(line, at + ahead)) for ahead in (0.0, _DIRECTION_M)
    )
    direction = np.arctan2(*(end - begin).T[::-1])
    runs, points = np.abs(wrap(direction - yaw[place])) < ALONG_RAD, np.stack([x, y], axis=-1)
    if road.raised:
        at_level = [same_level(height_on(road.lanes[k], points[i]), z[i]) for i, k in zip(place, lane, strict=True)]
        runs &= np.array(at_level, bool)  # keeps the shape where there are no pairs
    cos, sin = np.cos(direction), np.sin(direction)
    dx, dy = (points[place] - begin).T
    away, left_of_line = shapely.distance(line, where[place]), dy * cos - dx * sin >= 0.0
    near = place, lane, np.where(left_of_line, away, -away), length - at - (dx * cos + dy * sin)
    return _LanesNear(*(values[runs] for values in near))
