"""Where it happens: one of roundabout, merge, junction, straight and curve; none on a map without lanes.

Names after OpenLABEL's scenario tags (ASAM OpenLABEL 1.0.0): JunctionRoundabout, JunctionIntersection,
HorizontalStraights, HorizontalCurves.
"""

from typing import Literal

import numpy as np
import shapely

from regents_cosim.geometry.boxes import same_level
from regents_cosim.geometry.frames import wrap
from regents_cosim.geometry.lines import heading_near
from regents_cosim.maps.levels import height_on
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.tags.meeting import EGO
from regents_cosim.tags.seen import Seen

Place = Literal["roundabout", "merge", "junction", "straight", "curve"]
_NEAR_M = 12.0  # of where lanes cross or become one: two lanes and the length of a car
_RING_M = 250.0  # around a ring, at its centre line: a radius of 40 m, the largest roundabouts
_FULL_RAD = np.deg2rad(330.0)
_CROSS_RAD = np.deg2rad(30.0)  # between lanes, whichever way they run
_STRAIGHT_RAD = np.deg2rad(10.0)
_LOOK_M = 50.0  # along the lane, behind and ahead


def roundabout(seen: Seen) -> bool:
    """A lane within 12 m leads around a ring of at most 250 m, back into itself."""
    return _place(seen) == "roundabout"


def merge(seen: Seen) -> bool:
    """Within 12 m lanes become one, at less than 30 degrees, and none crosses them."""
    return _place(seen) == "merge"


def junction(seen: Seen) -> bool:
    """Within 12 m of lanes that cross at 30 degrees or more, on one level, or of a way through such a junction."""
    return _place(seen) == "junction"


def straight(seen: Seen) -> bool:
    """None of these, and the lane turns by less than 10 degrees from 50 m behind to 50 m ahead."""
    return _place(seen) == "straight"


def curve(seen: Seen) -> bool:
    """None of these, and the lane turns by more."""
    return _place(seen) == "curve"


def _place(seen: Seen) -> Place | None:
    at, near = shapely.Point(*seen.place), _near(seen)
    if not near:
        return None
    if any(is_ring(seen.scenario.road, lane) for lane in near):
        return "roundabout"
    if _cross(near, at):
        return "junction"
    return "merge" if _join(seen.scenario.road, near, at) else _bend(_own(seen, near), at)


def _near(seen: Seen) -> list[Lane]:
    """The lanes within 12 m of the ego that are on its level."""
    road, tracks = seen.scenario.road, seen.scenario.tracks
    found = sorted(road.centre_lines.query(shapely.Point(*seen.place), predicate="dwithin", distance=_NEAR_M))
    z = float(tracks.z[EGO, seen.moment])
    return [lane for lane in map(road.lanes.__getitem__, found) if same_level(height_on(lane, seen.place), z)]


def _own(seen: Seen, near: list[Lane]) -> Lane:
    """The ego's lane at the moment, else the first of those near it."""
    drive = seen.ego
    at = int(np.searchsorted(drive.steps, seen.moment).clip(max=len(drive.steps) - 1))
    return drive.front_lanes[at] or near[0]


def _cross(lanes: list[Lane], at: shapely.Point) -> bool:
    """Whether two lanes run at an angle: ways through a junction anywhere, others at a place. Opposite ways do not."""
    headings = np.concatenate([_headings_of(lane, at) for lane in lanes])
    between = np.abs(wrap(headings[:, None] - headings))
    return bool(((between > _CROSS_RAD) & (between < np.pi - _CROSS_RAD)).any())


def _headings_of(lane: Lane, at: shapely.Point) -> np.ndarray:
    """At its begin and end of a way through a junction, of another lane where it is nearest to a place [rad]."""
    if lane.junction:
        return _headings(lane.centre)[[0, -1]]
    return np.array([heading_near(shapely.LineString(lane.centre), at)])


def is_ring(road: RoadMap, lane: Lane) -> bool:
    """Whether lanes lead from its end back to its begin, by a full turn within 250 m."""
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
    """How far a line turns from begin to end [rad], positive to the left."""
    return float(np.sum(wrap(np.diff(_headings(points)))))


def _join(road: RoadMap, lanes: list[Lane], at: shapely.Point) -> bool:
    """Whether two of them end in one lane, near that place."""
    ending = [lane for lane in lanes if shapely.Point(lane.centre[-1]).distance(at) <= _NEAR_M]
    targets = [link.target for lane in ending for link in road.exits[lane.id]]
    return len(set(targets)) < len(targets)


def _bend(own: Lane, at: shapely.Point) -> Place:
    line = shapely.LineString(own.centre)
    here = float(line.project(at))
    marks = np.linspace(max(here - _LOOK_M, 0.0), min(here + _LOOK_M, line.length), 12)
    points = shapely.get_coordinates(shapely.line_interpolate_point(line, marks))
    headings = _headings(points)
    spread = np.cumsum(wrap(np.diff(headings)), dtype=float)
    return "straight" if float(np.abs(spread).max(initial=0.0)) < _STRAIGHT_RAD else "curve"


def _headings(points: np.ndarray) -> np.ndarray:
    """Of the pieces of a line [rad]."""
    ahead = np.diff(points, axis=0)
    moved = ahead[np.hypot(*ahead.T) > 1e-6]
    return np.arctan2(moved[:, 1], moved[:, 0]) if len(moved) else np.zeros(1)
