"""Tags for what the adversary does: it comes over, brakes, breaks the law, or its way crosses or joins the ego's.

The names of crossing ways follow the pre-crash scenarios of the NHTSA (Najm, Smith and Yanagisawa 2007, "Pre-Crash
Scenario Typology for Crash Avoidance Research", DOT HS 810 767): straight crossing paths (SCP), left turn across path
from the opposite or the lateral direction (LTAP/OD, LTAP/LD), turn into path (LTIP, RTIP).
"""

from typing import Literal

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.geometry.boxes import Boxes
from regents_cosim.geometry.frames import wrap
from regents_cosim.geometry.lines import end_heading, heading_near
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.norms.limits import AGAINST_RAD, ALONG_RAD, ONCOMING_SHARE, ONCOMING_STEPS, STANDING_M_S
from regents_cosim.routes.give_way import TURNED_RAD
from regents_cosim.routes.lane_matching import match_lanes
from regents_cosim.tags.meeting import CROSS_RAD, EGO, Meeting
from regents_cosim.tags.surroundings import is_ring
from regents_cosim.verdicts.law.oncoming import oncoming_share

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
    if not np.array_equal(lead.steps, meeting.steps):
        return False
    between = lead.in_front & (lead.ahead_m < meeting.ahead_m) & lead.same_way
    covered, left = np.flatnonzero(between & lead.in_way), np.flatnonzero(between & ~lead.in_way)
    if not (len(covered) and len(left) and covered[-1] < left[-1]):
        return False
    return bool((meeting.steps[-1] - meeting.steps[covered[-1]]) * meeting.scenario.dt <= _UNCOVERED_S)


# ISO 15622: adaptive cruise control need not brake harder, so a vehicle that follows by it cannot react
_HARD_M_S2 = 3.5
_LASTING_S = 0.5


def hard_brake(meeting: Meeting) -> bool:
    """The other, ahead in the ego's way and in it to the end, brakes by 3.5 m/s² or more over half a second."""
    over = max(round(_LASTING_S / meeting.scenario.dt), 1)
    if len(meeting.steps) <= over:
        return False
    speed = meeting.scenario.tracks.speed[meeting.other, meeting.steps]
    lost = speed[:-over] - speed[over:]
    # an agent that left the ego's way has not braked in front of it
    stays = np.arange(len(speed)) >= (meeting.entry or 0)
    leads = stays & meeting.in_way & meeting.in_front & meeting.same_way
    hard = lost >= _HARD_M_S2 * over * meeting.scenario.dt - 1e-9
    without_gap = meeting.steps[over:] - meeting.steps[:-over] == over
    return bool((hard & leads[:-over] & leads[over:] & without_gap).any())


_LATE_S = 1.0


def run_red_light(meeting: Meeting) -> bool:
    """The other passes the stop line of its movement on red, in the last 5 s."""
    return meeting.other in meeting.crash.acts("red_light", within_s=5.0)


def wrong_way(meeting: Meeting) -> bool:
    """In the last second over 17 % of the other vehicle is where only oncoming traffic may be, and it moves."""
    if meeting.scenario.agents[meeting.other].kind == "pedestrian":
        return False
    drive = meeting.drive(meeting.other)
    late = drive.steps >= meeting.step - round(_LATE_S / meeting.scenario.dt)
    body = Boxes(*(np.broadcast_to(values, late.shape)[late] for values in drive.box))
    # The law allows only an agent's own ways; here an agent on another way through a junction is not wrong-way.
    share = oncoming_share(meeting.scenario.road, body)
    return bool((share > ONCOMING_SHARE).sum() >= ONCOMING_STEPS and drive.speed[late].max() > STANDING_M_S)


From = Literal["behind or beside", "the side", "ahead"]
_BEGUN_RAD = np.deg2rad(10.0)  # turn that counts as begun on a way that turns


def crossing_path(meeting: Meeting) -> bool:
    """The other goes straight on, and the two ways cross at 30 degrees or more."""
    if meeting.entry is None or meeting.came_over is not None or turn_into_path(meeting):
        return False
    straight = not _turned(meeting) and _turning_lane(meeting) is None and abs(_change(meeting)) < ALONG_RAD
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
    return turns and abs(_between(meeting, -1)) <= AGAINST_RAD and ways_join(meeting)


def _between(meeting: Meeting, at: int) -> float:
    """The other's heading relative to the ego's at an index into `steps` [rad]."""
    return float(wrap(meeting.yaw(meeting.other)[at] - meeting.yaw(EGO)[at]))


def _at_an_angle(meeting: Meeting) -> bool:
    """Whether the two meet at an angle, neither driving along each other nor head on."""
    return CROSS_RAD <= abs(_between(meeting, -1)) <= np.pi - CROSS_RAD


def _comes_from(meeting: Meeting) -> From:
    before = abs(_between(meeting, 0))
    return "behind or beside" if before < ALONG_RAD else "the side" if before < AGAINST_RAD else "ahead"


def _turned(meeting: Meeting) -> bool:
    """Whether the other has turned at a junction or is on a way that turns; anywhere on a map without junctions."""
    since = _inside_since(meeting) if any(lane.junction for lane in meeting.scenario.road.lanes) else 0
    return abs(_change(meeting, since)) >= (TURNED_RAD if _turning_lane(meeting) is None else _BEGUN_RAD)


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
    turn = end_heading(lane.centre) - end_heading(lane.centre[:2])
    return lane if abs(float(wrap(turn))) >= ALONG_RAD else None


_MERGE_M = 30.0  # distance ahead within which lanes become one
_AHEAD_M = 30.0  # distance beyond the contact; a junction lies behind both by then
_SPACING_M = 2.0


def lanes_merge(meeting: Meeting, at: int) -> bool:
    """Whether the lanes of the two before index `at` lead into one lane within 30 m."""
    road = meeting.scenario.road
    step = int(meeting.steps[max(at - 1, 0)])
    one, two = (_place(meeting, agent, step) for agent in (EGO, meeting.other))
    if one is None or two is None or one[0] is two[0]:
        return False
    ways = [_onward(road, lane, _MERGE_M - left_m) for lane, left_m in (one, two)]
    return two[0].id not in ways[0] and one[0].id not in ways[1] and bool(ways[0] & ways[1])


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
    return abs(float(wrap(heading_near(lane.line, shapely.Point(*place)) - yaw))) < ALONG_RAD


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


def _place(meeting: Meeting, agent: int, step: int) -> tuple[Lane, float] | None:
    """The lane under an agent's front, and how far it is to the lane's end [m]; None on no lane."""
    drive = meeting.drive(agent)
    at = int(np.searchsorted(drive.steps, step))
    lane = drive.front_lanes[at]
    if lane is None:
        return None
    return lane, lane.length - lane.line.project(shapely.Point(*drive.front[at]))


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
