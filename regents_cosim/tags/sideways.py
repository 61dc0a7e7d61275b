"""Who comes into the ego's way from the side while both drive the same way, or leaves it."""

import numpy as np

from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.tags.meeting import EGO, Meeting

_MERGE_M = 80.0  # that lanes may go on before they become one


def cut_in(meeting: Meeting) -> bool:
    """The other comes from a lane beside into the ego's way, ahead of the ego's front."""
    at = _came_over(meeting)
    return at is not None and bool(meeting.in_front[at]) and not _lanes_merge(meeting, at)


def lane_drift(meeting: Meeting) -> bool:
    """The other comes over sideways into the ego, beside it."""
    at = _came_over(meeting)
    return at is not None and not meeting.in_front[at] and not _lanes_merge(meeting, at)


def merge_squeeze(meeting: Meeting) -> bool:
    """Both drive the same way, their two lanes become one, and the other is in it with the ego."""
    at = meeting.entry
    return at is not None and bool(meeting.same_way.all()) and _lanes_merge(meeting, at)


def cut_out(meeting: Meeting) -> bool:
    """A third one, between the ego and the other, leaves the ego's way sideways, and the other stands in it."""
    if not (meeting.in_way[-1] and meeting.in_front.all() and meeting.same_way[-1]):
        return False
    scenario, step = meeting.scenario, meeting.step
    others = (one for one in range(1, len(scenario.agents)) if one != meeting.other)
    return any(_uncovers(Meeting(scenario, one, step), meeting) for one in others)


def _came_over(meeting: Meeting) -> int | None:
    """When the other moved sideways into the ego's way, both driving the same way; None where it did not."""
    at = meeting.entry
    if at is None or not meeting.same_way[at - 1 : at + 1].all() or not meeting.other_came_over:
        return None
    return at


def _uncovers(lead: Meeting, meeting: Meeting) -> bool:
    if not len(lead.steps) or len(lead.steps) != len(meeting.steps):
        return False
    between = lead.in_front & (lead.ahead_m < meeting.ahead_m) & lead.same_way
    covered = between & lead.in_way
    left = between & ~lead.in_way
    return bool(covered.any() and left.any() and np.argmax(covered) < len(left) - 1 - np.argmax(left[::-1]))


def _lanes_merge(meeting: Meeting, at: int) -> bool:
    """Whether the lanes that the two were in before step `at` lead into one lane soon."""
    road = meeting.scenario.road
    step = int(meeting.steps[max(at - 1, 0)])
    one, two = (_lane(meeting, agent, step) for agent in (EGO, meeting.other))
    if one is None or two is None or one is two:
        return False
    ways = [_onward(road, lane) for lane in (one, two)]
    return two.id not in ways[0] and one.id not in ways[1] and bool(ways[0] & ways[1])


def _lane(meeting: Meeting, agent: int, step: int) -> Lane | None:
    drive = meeting.drive(agent)
    return drive.front_lanes[int(np.searchsorted(drive.steps, step))]


def _onward(road: RoadMap, lane: Lane) -> set[str]:
    """The lanes that follow it within 80 m."""
    found: set[str] = set()
    waiting = [(link.target, _MERGE_M) for link in road.exits[lane.id]]
    while waiting:
        name, left = waiting.pop()
        if name not in found:
            found.add(name)
            rest = left - road.lane[name].length
            waiting += [(link.target, rest) for link in road.exits[name]] if rest > 0.0 else []
    return found
