"""Tags for an agent that enters or leaves the ego's way from the side while both drive the same way."""

import numpy as np

from regents_cosim.tags.joining import lanes_merge
from regents_cosim.tags.meeting import EGO, Meeting

_BESIDE = 1 / 3  # share of the shorter body, along the ego's way; with less overlap one is ahead or behind
_SLOW = 0.5  # of the ego's speed
_UNCOVERED_S = 3.0  # before the contact: an agent that is seen for longer is a slow vehicle ahead


def cut_in(meeting: Meeting) -> bool:
    """The other comes from a lane beside into the ego's way, and is ahead of the ego when they touch."""
    return _over(meeting) and meeting.ahead_m[-1] > 0.0 and not _beside(meeting)


def lane_drift(meeting: Meeting) -> bool:
    """The other comes over sideways into the ego, and is beside it when they touch."""
    return _over(meeting) and _beside(meeting)


def merge_squeeze(meeting: Meeting) -> bool:
    """Both drive the same way, their two lanes become one, and the other is in it with the ego."""
    at = meeting.entry
    return at is not None and bool(meeting.same_way.all()) and lanes_merge(meeting, at)


def cut_out(meeting: Meeting) -> bool:
    """In the last 3 s a third vehicle, between the two, leaves the ego's way sideways; the other is in it, and slow."""
    if meeting.entry is not None or not (meeting.in_front.all() and meeting.same_way[-1]):
        return False
    scenario, step = meeting.scenario, meeting.step
    fastest = scenario.tracks.speed[:, meeting.steps].max(axis=1)
    if fastest[meeting.other] > _SLOW * fastest[EGO]:
        return False
    others = (one for one in range(1, len(scenario.agents)) if one != meeting.other)
    return any(_uncovers(Meeting(scenario, one, step), meeting) for one in others)


def _over(meeting: Meeting) -> bool:
    at = meeting.came_over
    return at is not None and bool(meeting.same_way[-1]) and not lanes_merge(meeting, at)


def _beside(meeting: Meeting) -> bool:
    return bool(meeting.beside[-1] >= _BESIDE)


def _uncovers(lead: Meeting, meeting: Meeting) -> bool:
    if not len(lead.steps) or len(lead.steps) != len(meeting.steps):
        return False
    between = lead.in_front & (lead.ahead_m < meeting.ahead_m) & lead.same_way
    covered, left = np.flatnonzero(between & lead.in_way), np.flatnonzero(between & ~lead.in_way)
    if not (len(covered) and len(left) and covered[-1] < left[-1]):
        return False
    return bool((meeting.steps[-1] - meeting.steps[covered[-1]]) * meeting.scenario.dt <= _UNCOVERED_S)
