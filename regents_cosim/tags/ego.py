"""Tags for what the ego does up to the contact, or in the whole window if there is none, and for lights on its way."""

import numpy as np

from regents_cosim.geometry.frames import wrap
from regents_cosim.norms.limits import STANDING_M_S
from regents_cosim.tags.case_values import CaseValues
from regents_cosim.verdicts.law.lane_pieces import neighbours

_TURN_RAD = np.deg2rad(45.0)
_TURN_M = 40.0  # length of way: a radius of 50 m, beyond which a road merely bends
_STOPS_S = 1.0


def ego_turns_left(seen: CaseValues) -> bool:
    """The ego's heading turns left by 45 degrees or more within 40 m of its way."""
    return _sharpest(seen)[1] >= _TURN_RAD


def ego_turns_right(seen: CaseValues) -> bool:
    """The ego's heading turns right by 45 degrees or more within 40 m of its way."""
    return _sharpest(seen)[0] <= -_TURN_RAD


def ego_changes_lane(seen: CaseValues) -> bool:
    """The ego's front passes into the lane beside its own."""
    beside = neighbours(seen.scenario.road)
    return any(after.id in beside[before.id] for _, before, after in seen.ego.entered)


def ego_stops(seen: CaseValues) -> bool:
    """The ego has moved, and then stands for a second or more."""
    stands = seen.ego.speed < STANDING_M_S
    begin, end = seen.ego.longest(stands & np.logical_or.accumulate(~stands))
    return (end - begin) * seen.scenario.dt >= _STOPS_S


def ego_goes_straight(seen: CaseValues) -> bool:
    """The ego neither turns, nor changes lanes, nor stops."""
    return not any(does(seen) for does in (ego_turns_left, ego_turns_right, ego_changes_lane, ego_stops))


def traffic_light(seen: CaseValues) -> bool:
    """The ego, or the other, passes or approaches a connection that has a light."""
    signals = {signal.id for signal in seen.scenario.signals}
    drives = [seen.ego, *([seen.meeting.drive(seen.meeting.other)] if seen.meeting else [])]
    lanes = {lane.id for drive in drives for lane in drive.front_lanes if lane is not None}
    return any(link.signal in signals for name in lanes for link in seen.scenario.road.exits[name])


def _sharpest(seen: CaseValues) -> tuple[float, float]:
    """The sharpest turns of the ego's heading within 40 m, to the right (negative) and to the left [rad]."""
    way = np.cumsum(seen.ego.moved_m)
    turned = np.cumsum(wrap(np.diff(seen.ego.yaw, prepend=seen.ego.yaw[:1])))
    behind = np.searchsorted(way, way - _TURN_M)
    spans = [turned[k] - turned[first : k + 1] for k, first in enumerate(behind.tolist())]
    return min((float(s.min()) for s in spans), default=0.0), max((float(s.max()) for s in spans), default=0.0)
