"""Whether the ways of the ego and the other become one, by the lanes that they lead along."""

import numpy as np

from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.routes.lane_matching import match_lanes
from regents_cosim.tags.meeting import EGO, Meeting
from regents_cosim.tags.place import is_ring

_MERGE_M = 80.0  # that lanes may go on before they become one
_AHEAD_M = 30.0  # of the place where they touch: a junction is behind them by then
_SPACING_M = 2.0


def lanes_merge(meeting: Meeting, at: int) -> bool:
    """Whether the lanes that the two were in before step `at` lead into one lane soon."""
    road = meeting.scenario.road
    step = int(meeting.steps[max(at - 1, 0)])
    one, two = (_lane(meeting, agent, step) for agent in (EGO, meeting.other))
    if one is None or two is None or one is two:
        return False
    ways = [_onward(road, lane, _MERGE_M) for lane in (one, two)]
    return two.id not in ways[0] and one.id not in ways[1] and bool(ways[0] & ways[1])


def ways_join(meeting: Meeting) -> bool:
    """Whether the lane that the other is in when they touch leads into one that the ego is about to drive along."""
    road, lane = meeting.scenario.road, meeting.drive(meeting.other).front_lanes[-1]
    return lane is not None and bool(({lane.id} | _onward(road, lane, _AHEAD_M)) & _egos(meeting))


def on_ring(meeting: Meeting, agent: int) -> bool:
    """Whether one of them is in a roundabout when they touch."""
    lane = meeting.drive(agent).front_lanes[-1]
    return lane is not None and is_ring(meeting.scenario.road, lane)


def _egos(meeting: Meeting) -> set[str]:
    """The lanes along which the ego's way leads on."""
    scenario, path = meeting.scenario, meeting.path
    x, y, _ = path.at(path.driven[meeting.step] + np.arange(0.0, _AHEAD_M, _SPACING_M))
    found = match_lanes(scenario.road, np.stack([x, y], axis=1), scenario.heights.of(EGO, x, y))
    return {lane.id for lane in found if lane is not None}


def _lane(meeting: Meeting, agent: int, step: int) -> Lane | None:
    drive = meeting.drive(agent)
    return drive.front_lanes[int(np.searchsorted(drive.steps, step))]


def _onward(road: RoadMap, lane: Lane, reach_m: float) -> set[str]:
    """The lanes that follow it within so far."""
    found: set[str] = set()
    waiting = [(link.target, reach_m) for link in road.exits[lane.id]]
    while waiting:
        name, left = waiting.pop()
        if name not in found:
            found.add(name)
            rest = left - road.lane[name].length
            waiting += [(link.target, rest) for link in road.exits[name]] if rest > 0.0 else []
    return found
