"""Rank drives that meet the ego: first those that a driver in its place would see coming, but the ego may not.

The ranking uses rules of thumb, by geometry alone.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from regents_cosim.attacks.starts.meeting import MeetingDrives, MeetingPair, ahead_of_ego, contact_of
from regents_cosim.geometry.frames import ahead_and_left, wrap
from regents_cosim.norms.careful import FORESIGHT
from regents_cosim.norms.foresight import along_arc, between_lanes, comes_over
from regents_cosim.norms.limits import ALONG_RAD
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.verdicts.careful.lane_keeping import from_lane_centre

_NEEDED_S = 3.0  # a careful driver who sees it coming for this long avoids it
_LEADS = 0.9  # share of the ego's length ahead of its centre: the ego runs into its rear
_SEEN_S = 2.0  # before the crash: a careful driver needs this long to see, decide and brake
_MARGIN_M = 0.3  # beside the ego: a pedestrian there is in its way
_HASTE = 0.3  # [1/(m/s^2)] so that usual adversaries come first
_YIELDS = 0.5  # a crash by one that fails to give way is not flawless
_LINGERS_S = 1.5  # in its way for longer, any planner sees it


def promise_of(drives: MeetingDrives, own: tuple[np.ndarray, ...], scenario: Scenario) -> Float[np.ndarray, " drive"]:
    """How likely a careful driver foresees the crash and the planner does not, by rules of thumb.

    An agent in the ego's direction is suspected only while its centre is ahead of the ego's, or beside an ego that is
    about to change lanes.
    """
    ahead, turn = contact_of(drives, own).T
    over = _comes_over(own, scenario)
    seen_from = np.maximum(drives.meets - round(_SEEN_S / scenario.dt), 0)
    crossing = np.abs(turn) > ALONG_RAD
    unseen = ~crossing & (np.minimum(ahead, ahead_of_ego(drives, seen_from, own)) <= 0.0)
    unseen &= ~(over[seen_from] & _beside(drives, seen_from, own, scenario))
    leads = ~crossing & (ahead > _LEADS * scenario.ego.length)
    foreseen = np.clip(_foreseen_s(drives, own, scenario, over) / _NEEDED_S, 0.0, 1.0)
    by_rules = 0.5 * crossing - _YIELDS * drives.yields - 1.0 * unseen - 0.4 * leads
    return 1.5 * foreseen - _HASTE * drives.gentle + by_rules


def promise_on_foot(drives: MeetingDrives, pair: MeetingPair, dt: float) -> Float[np.ndarray, " drive"]:
    """A penalty for walks that are long in the ego's way before, where any planner sees them, or end in its side."""
    x, y, yaw = pair.own
    _, left = ahead_and_left(np, drives.x - x, drives.y - y, yaw)
    in_way = np.abs(left) < 0.5 * (pair.its[1] + pair.mine[1]) + _MARGIN_M
    before = drives.meets[:, None] - np.arange(in_way.shape[1])
    lingers_s = ((before > 0) & (before * dt <= _LINGERS_S) & in_way).sum(axis=1) * dt
    ahead = ahead_of_ego(drives, drives.meets, pair.own)
    return -1.0 * lingers_s / _LINGERS_S - 1.0 * (ahead < 0.5 * pair.its[0])


def _comes_over(own: tuple[np.ndarray, ...], scenario: Scenario) -> Bool[np.ndarray, " time"]:
    """Whether the ego is about to leave the middle of its lane for another, at every step."""
    x, y, yaw = own
    between = between_lanes(np.abs(from_lane_centre(scenario.road, x, y, yaw, scenario.heights.of(0, x, y))))
    now = np.arange(len(x))
    return comes_over(between, now, now, now + round(FORESIGHT.ahead_s / scenario.dt))


def _beside(
    drives: MeetingDrives, step: Int[np.ndarray, " drive"], own: tuple[np.ndarray, ...], scenario: Scenario
) -> Bool[np.ndarray, " drive"]:
    """Which drives are beside the ego at a step of their own, not half a length behind: those hit its back."""
    return np.abs(ahead_of_ego(drives, step, own)) < 0.5 * scenario.ego.length


def _foreseen_s(
    drives: MeetingDrives, own: tuple[np.ndarray, ...], scenario: Scenario, over: Bool[np.ndarray, " time"]
) -> Float[np.ndarray, " drive"]:
    """The time [s] before the crash during which a careful driver would have foreseen it.

    That is while the candidate, if it kept its speed and turn, would meet the ego, at most half a second early or late;
    and while it crosses the ego's way, visibly leaves its lane, or is beside an ego that is about to change lanes.
    """
    dt, rows = scenario.dt, np.arange(len(drives.meets))
    near_m = 0.5 * (scenario.ego.length + scenario.ego.width)
    early_or_late = [round(FORESIGHT.spacing_s / dt * n) for n in range(-FORESIGHT.slack, FORESIGHT.slack + 1)]
    lasts, foreseen = np.ones(len(rows), bool), np.zeros(len(rows))
    for before in range(2, round(_NEEDED_S / dt) + 1, 2):
        step = drives.meets - before
        at, past = np.maximum(step, 0), np.maximum(step - round(FORESIGHT.over_s / dt), 0)
        x, y, yaw, speed = (values[rows, at] for values in (drives.x, drives.y, drives.yaw, drives.speed))
        turned = (yaw - drives.yaw[rows, past]) * before / np.maximum(at - past, 1)
        x, y, yaw = along_arc(np, x, y, yaw, turned, speed * before * dt)
        late = [np.clip(drives.meets + shift, 0, len(own[0]) - 1) for shift in early_or_late]
        away = np.min([np.hypot(x - own[0][when], y - own[1][when]) for when in late], axis=0)
        angle = np.abs(wrap(yaw - own[2][drives.meets]))
        suspected = ((angle > FORESIGHT.along_rad) & (angle < FORESIGHT.against_rad)) | (step * dt >= drives.shows_s)
        suspected |= over[at] & _beside(drives, at, own, scenario)
        lasts &= (step >= 0) & (away < near_m) & suspected
        foreseen[lasts] = before * dt
    return foreseen
