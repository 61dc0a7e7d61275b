"""Decide whether the ways of the ego and the other join, by the lanes that they follow."""

from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.geometry.frames import wrap
from regents_cosim.geometry.lines import heading_near
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.norms.limits import ALONG_RAD
from regents_cosim.routes.lane_matching import match_lanes
from regents_cosim.tags.meeting import EGO, Meeting
from regents_cosim.tags.surroundings import is_ring

_MERGE_M = 30.0  # distance ahead within which lanes become one
_AHEAD_M = 30.0  # distance beyond the contact; a junction lies behind both by then
_SPACING_M = 2.0


def lanes_merge(meeting: Meeting, at: int) -> bool:
    """Whether the lanes of the two before index `at` lead into one lane within 30 m."""
    road = meeting.scenario.road
    step = int(meeting.steps[max(at - 1, 0)])
    one, two = (_place(meeting, agent, step) for agent in (EGO, meeting.other))
    if one is None or two is None or one.lane is two.lane:
        return False
    ways = [_onward(road, place.lane, _MERGE_M - place.left_m) for place in (one, two)]
    return two.lane.id not in ways[0] and one.lane.id not in ways[1] and bool(ways[0] & ways[1])


def ways_join(meeting: Meeting) -> bool:
    """Whether the lane that the other follows leads into a lane that the ego is about to drive along."""
    road, lane = meeting.scenario.road, followed(meeting)
    return lane is not None and bool(({lane.id} | _onward(road, lane, _AHEAD_M)) & _egos(meeting))


def followed(meeting: Meeting) -> Lane | None:
    """The last lane that the other follows, not one that it only crosses; None if it is on no lane."""
    drive, own = meeting.drive(meeting.other), None
    for at, lane in enumerate(drive.front_lanes):
        if lane is None or lane is own:
            continue
        if own is None or lane.id in _next(meeting.scenario.road, own) or _leads(lane, drive.front[at], drive.yaw[at]):
            own = lane
    return own


def _next(road: RoadMap, lane: Lane) -> set[str | None]:
    return {lane.left, lane.right} | _onward(road, lane, _AHEAD_M)


def _leads(lane: Lane, place: Float[np.ndarray, " 2"], yaw: float) -> bool:
    return abs(float(wrap(heading_near(shapely.LineString(lane.centre), shapely.Point(*place)) - yaw))) < ALONG_RAD


def on_ring(meeting: Meeting, agent: int) -> bool:
    """Whether an agent is in a roundabout at the contact."""
    lane = meeting.drive(agent).front_lanes[-1]
    return lane is not None and is_ring(meeting.scenario.road, lane)


def _egos(meeting: Meeting) -> set[str]:
    """Ids of the lanes along the ego's way ahead, and of those after its lane while the road leaves no choice."""
    scenario, path = meeting.scenario, meeting.path
    x, y, _ = path.at(path.driven[meeting.step] + np.arange(0.0, _AHEAD_M, _SPACING_M))
    found = match_lanes(scenario.road, np.stack([x, y], axis=1), scenario.heights.of(EGO, x, y))
    lane = meeting.drive(EGO).front_lanes[-1]
    return {lane.id for lane in found if lane is not None} | (set() if lane is None else _forced(scenario.road, lane))


def _forced(road: RoadMap, lane: Lane) -> set[str]:
    found, left_m = set[str](), _AHEAD_M
    while left_m > 0.0 and len(exits := road.exits[lane.id]) == 1:
        lane = road.lane[exits[0].target]
        found.add(lane.id)
        left_m -= lane.length
    return found


@dataclass(frozen=True)
class _Place:
    lane: Lane
    left_m: float  # [m] to the end of the lane


def _place(meeting: Meeting, agent: int, step: int) -> _Place | None:
    drive = meeting.drive(agent)
    at = int(np.searchsorted(drive.steps, step))
    lane = drive.front_lanes[at]
    if lane is None:
        return None
    line = shapely.LineString(lane.centre)
    return _Place(lane, line.length - line.project(shapely.Point(*drive.front[at])))


def _onward(road: RoadMap, lane: Lane, reach_m: float) -> set[str]:
    """The ids of the lanes that follow `lane` within `reach_m`."""
    found: set[str] = set()
    waiting = [(link.target, reach_m) for link in road.exits[lane.id]] if reach_m > 0.0 else []
    while waiting:
        name, left = waiting.pop()
        if name not in found:
            found.add(name)
            rest = left - road.lane[name].length
            waiting += [(link.target, rest) for link in road.exits[name]] if rest > 0.0 else []
    return found
