"""Tags for an adversary whose way crosses or joins the ego's, by where both come from and how far the other turned.

The names follow the pre-crash scenarios of the NHTSA (Najm, Smith and Yanagisawa 2007, "Pre-Crash Scenario Typology for
Crash Avoidance Research", DOT HS 810 767): straight crossing paths (SCP), left turn across path from the opposite or
the lateral direction (LTAP/OD, LTAP/LD), turn into path (LTIP, RTIP).
"""

from typing import Literal

import numpy as np
from jaxtyping import Float

from regents_cosim.geometry.frames import wrap
from regents_cosim.maps.roadmap import Lane
from regents_cosim.tags.joining import followed, on_ring, ways_join
from regents_cosim.tags.meeting import CROSS_RAD, EGO, Meeting

From = Literal["behind or beside", "the side", "ahead"]
_TURNED_RAD = np.deg2rad(25.0)  # the turn from which the rules of fault speak of turning
_ALONG_RAD, _AGAINST_RAD = np.deg2rad(45.0), np.deg2rad(135.0)
_BEGUN_RAD = np.deg2rad(10.0)  # turn that counts as begun on a way that turns


def crossing_path(meeting: Meeting) -> bool:
    """The other goes straight on, and the two ways cross at 30 degrees or more."""
    if meeting.entry is None or meeting.came_over is not None or turn_into_path(meeting):
        return False
    straight = not _turned(meeting) and _turning_lane(meeting) is None and abs(_change(meeting)) < _ALONG_RAD
    return straight and _at_an_angle(meeting)


def turn_across_path(meeting: Meeting) -> bool:
    """The other turns across the ego's way: from ahead, from the side, or from a lane beside."""
    if not (_turned(meeting) and _at_an_angle(meeting)) or ways_join(meeting):
        return False
    return _comes_from(meeting) != "behind or beside" or meeting.entry is not None


def turn_into_path(meeting: Meeting) -> bool:
    """The other comes from another road and turns into the ego's way, or enters the roundabout that the ego is in."""
    if _comes_from(meeting) == "behind or beside" or meeting.came_over is not None or on_ring(meeting, meeting.other):
        return False
    turns = _turned(meeting) or on_ring(meeting, EGO)
    return turns and abs(_between(meeting, -1)) <= _AGAINST_RAD and ways_join(meeting)


def _between(meeting: Meeting, at: int) -> float:
    """The other's heading relative to the ego's at an index into `steps` [rad]."""
    return float(wrap(meeting.yaw(meeting.other)[at] - meeting.yaw(EGO)[at]))


def _at_an_angle(meeting: Meeting) -> bool:
    """Whether the two meet at an angle, neither driving along each other nor head on."""
    return CROSS_RAD <= abs(_between(meeting, -1)) <= np.pi - CROSS_RAD


def _comes_from(meeting: Meeting) -> From:
    before = abs(_between(meeting, 0))
    return "behind or beside" if before < _ALONG_RAD else "the side" if before < _AGAINST_RAD else "ahead"


def _turned(meeting: Meeting) -> bool:
    """Whether the other has turned at a junction or is on a way that turns; anywhere on a map without junctions."""
    since = _inside_since(meeting) if any(lane.junction for lane in meeting.scenario.road.lanes) else 0
    return abs(_change(meeting, since)) >= (_TURNED_RAD if _turning_lane(meeting) is None else _BEGUN_RAD)


def _change(meeting: Meeting, since: int = 0) -> float:
    """The turn of the other [rad] from an index into `steps` to the contact; 0 if the index lies beyond the end."""
    yaw = meeting.yaw(meeting.other)[since:]
    return float(yaw[-1] - yaw[0]) if len(yaw) else 0.0


def _inside_since(meeting: Meeting) -> int:
    """The index into `steps` at which the other entered the first junction; `len(steps)` if it entered none."""
    drive = meeting.drive(meeting.other)
    lanes = [drive.front_lanes[at] for at in np.searchsorted(drive.steps, meeting.steps)]
    return next((at for at, lane in enumerate(lanes) if lane is not None and lane.junction), len(lanes))


def _turning_lane(meeting: Meeting) -> Lane | None:
    """The way through a junction that the other is on at the end, if that way turns by 45 degrees or more."""
    lane = followed(meeting)
    if lane is None or not lane.junction:
        return None
    begin, end = (_heading(*ends) for ends in (lane.centre[:2], lane.centre[-2:]))
    return lane if abs(float(wrap(end - begin))) >= _ALONG_RAD else None


def _heading(one: Float[np.ndarray, " 2"], other: Float[np.ndarray, " 2"]) -> float:
    """The direction from one place to another [rad]."""
    return float(np.arctan2(*(other - one)[::-1]))
