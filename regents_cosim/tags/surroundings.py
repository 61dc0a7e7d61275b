"""The kind of road around a place: a roundabout, a merge, a junction, straight or a curve."""

from typing import Literal

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.geometry.boxes import same_level
from regents_cosim.geometry.frames import wrap
from regents_cosim.geometry.lines import heading_near
from regents_cosim.maps.levels import height_on
from regents_cosim.maps.roadmap import Lane, RoadMap

Place = Literal["roundabout", "merge", "junction", "straight", "curve"]
_NEAR_M = 12.0  # distance to where lanes cross or join: two lanes and the length of a car
_RING_M = 250.0  # length around a ring along its centre line: a radius of 40 m, as of the largest roundabouts
_FULL_RAD = np.deg2rad(330.0)
_CROSS_RAD = np.deg2rad(30.0)  # angle between lanes, in whichever direction they run
_STRAIGHT_RAD = np.deg2rad(10.0)
_LOOK_M = 50.0  # along the lane, behind and ahead


def surroundings(road: RoadMap, place: Float[np.ndarray, " 2"], z: float, own: Lane | None) -> Place | None:
    """The kind of road around a place [m] at height `z` [m], for an agent on lane `own`; None where no lane is near."""
    at = shapely.Point(*place)
    found = sorted(road.centre_lines.query(at, predicate="dwithin", distance=_NEAR_M))
    near = [lane for lane in map(road.lanes.__getitem__, found) if same_level(height_on(lane, place), z)]
    if not near:
        return None
    if any(is_ring(road, lane) for lane in near):
        return "roundabout"
    if _cross(near, at):
        return "junction"
    return "merge" if _join(road, near, at) else _bend(own or near[0], at)


def _cross(lanes: list[Lane], at: shapely.Point) -> bool:
    """Whether two lanes cross at an angle: ways through a junction anywhere, other lanes near `at`."""
    headings = np.concatenate([_headings_of(lane, at) for lane in lanes])
    between = np.abs(wrap(headings[:, None] - headings))
    return bool(((between > _CROSS_RAD) & (between < np.pi - _CROSS_RAD)).any())


def _headings_of(lane: Lane, at: shapely.Point) -> np.ndarray:
    """Headings [rad] of a way through a junction at both its ends, of another lane at its point nearest to `at`."""
    if lane.junction:
        return _headings(lane.centre)[[0, -1]]
    return np.array([heading_near(lane.line, at)])


def is_ring(road: RoadMap, lane: Lane) -> bool:
    """Whether lanes lead from the end of `lane` back to its begin, by a full turn within 250 m."""
    seen: set[str] = set()
    waiting = [(lane, lane.length, _turned(lane.centre))]
    while waiting:
        here, way, turned = waiting.pop()
        for link in road.exits[here.id]:
            then = road.lane[link.target]
            onward = way + then.length, turned + _turned(np.concatenate([here.centre[-2:], then.centre]))
            if then is lane and abs(onward[1] - _turned(lane.centre)) >= _FULL_RAD:
                return True
            if then.id not in seen and onward[0] <= _RING_M:
                seen.add(then.id)
                waiting.append((then, *onward))
    return False


def _turned(points: np.ndarray) -> float:
    """How far a line turns from its begin to its end [rad], positive to the left."""
    return float(np.sum(wrap(np.diff(_headings(points)))))


def _join(road: RoadMap, lanes: list[Lane], at: shapely.Point) -> bool:
    """Whether two of the lanes end in one lane near `at`."""
    ending = [lane for lane in lanes if shapely.Point(lane.centre[-1]).distance(at) <= _NEAR_M]
    targets = [link.target for lane in ending for link in road.exits[lane.id]]
    return len(set(targets)) < len(targets)


def _bend(own: Lane, at: shapely.Point) -> Place:
    line = own.line
    here = float(line.project(at))
    marks = np.linspace(max(here - _LOOK_M, 0.0), min(here + _LOOK_M, line.length), 12)
    points = shapely.get_coordinates(shapely.line_interpolate_point(line, marks))
    headings = _headings(points)
    spread = np.cumsum(wrap(np.diff(headings)), dtype=float)
    return "straight" if float(np.abs(spread).max(initial=0.0)) < _STRAIGHT_RAD else "curve"


def _headings(points: np.ndarray) -> np.ndarray:
    """Directions of the segments of a line [rad]."""
    ahead = np.diff(points, axis=0)
    moved = ahead[np.hypot(*ahead.T) > 1e-6]
    return np.arctan2(moved[:, 1], moved[:, 0]) if len(moved) else np.zeros(1)
