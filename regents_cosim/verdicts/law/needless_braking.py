"""Find a vehicle that stops, or brakes hard, although nothing ahead of it asks for that.

Source: Vienna Convention on Road Traffic (1968), art. 17(1): no driver brakes abruptly unless safety asks for it; art.
25(1): none stands on a motorway. Whatever could be a reason counts as one: where roads meet, bend or end within the
distance in which a driver would brake for it, and where anybody is ahead there, or about to be.
"""

import numpy as np

from regents_cosim.geometry.frames import ahead_and_left, wrap
from regents_cosim.maps.right_of_way import priorities
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.norms.careful import CAREFUL
from regents_cosim.norms.foresight import breadth
from regents_cosim.norms.limits import STANDING_M_S, steps_of
from regents_cosim.routes.give_way import TURNED_RAD
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.verdicts.handling import MEAN_S
from regents_cosim.verdicts.law.drive import AgentDrive, OffendingAct
from regents_cosim.verdicts.law.lane_pieces import lane_lines
from regents_cosim.verdicts.law.meeting_ways import met_by

_LASTS_S = 0.5
_MOVED_M_S = 2.0  # who was never faster does not come to a stop: parked cars of recordings seem to move
_SEEN_S = 2.0  # a driver that looks so far ahead, and goes on so long after a reason is gone ...
_ROOM_M = 10.0  # ... and leaves so much room brakes comfortably for what it sees
_COMES_S = 4.0  # others that will be in its way by then are a reason
_ASIDE_M = 0.5  # and so are those that pass it by less
_GOES = "gG-"  # letters of a light that lets it go, or of none


def brakes_needlessly(drive: AgentDrive, partner: AgentDrive | None) -> OffendingAct | None:
    """It stops, or brakes harder than is comfortable, without a reason for 0.5 s; amount: its hardest braking."""
    dt, speed = drive.scenario.dt, drive.speed
    steps = max(int(steps_of(np, MEAN_S, dt)), 1)
    braking = np.zeros(len(speed))
    braking[:-steps] = np.maximum(speed[:-steps] - speed[steps:], 0.0) / (steps * dt)
    stops = (speed < STANDING_M_S) & (np.maximum.accumulate(speed) > _MOVED_M_S)
    acts = stops | (braking > CAREFUL.comfortable_m_s2)
    lately, reason = np.ones(int(steps_of(np, _SEEN_S, dt)) + 1), np.zeros(len(speed))
    for at in np.flatnonzero(np.convolve(acts, lately)[len(lately) - 1 :]).tolist():
        reason[at] = _has_reason(drive, at)
    without = np.convolve(reason, lately)[: len(speed)] == 0.0
    return drive.lasting(acts & without, braking, max(int(steps_of(np, _LASTS_S, dt)), 1))


def _has_reason(drive: AgentDrive, at: int) -> bool:
    """Whether anything ahead asks it to brake at one of its steps; also where no lane is under it."""
    road, here = drive.scenario.road, drive.own.point == at
    reach = float(_SEEN_S * drive.speed[at] + drive.speed[at] ** 2 / (2.0 * CAREFUL.comfortable_m_s2)) + _ROOM_M
    ahead = dict[str, float]()  # lanes within reach, with the distance of their ends
    for index, along in zip(drive.own.lane[here].tolist(), drive.own.along[here].tolist(), strict=True):
        _look_ahead(road, road.lanes[index], lane_lines(road)[road.lanes[index].id].length - along, reach, ahead)
    step = int(drive.steps[at])
    asked = any(_asks(drive.scenario, road.lane[name], end < reach, step) for name, end in ahead.items())
    return not ahead or asked or _is_anybody_ahead(drive, at, step, reach)


def _look_ahead(road: RoadMap, lane: Lane, end_m: float, reach: float, found: dict[str, float]) -> None:
    """Add the lanes that begin within reach [m], each with the distance of its end, to those found."""
    if end_m < found.get(lane.id, np.inf):
        found[lane.id] = end_m
        for target in (road.lane[link.target] for link in road.exits[lane.id] if end_m < reach):
            _look_ahead(road, target, end_m + target.length, reach, found)


def _asks(scenario: Scenario, lane: Lane, ends: bool, step: int) -> bool:
    """Whether a lane bends, crosses others that go first, or leads to an end, a sign or a light that is not green."""
    road, table = scenario.road, priorities(scenario.road)
    shown = [scenario.shows(link.signal, link.link, step) for link in road.exits[lane.id]]
    if ends and (not shown or lane.approach or any(letter not in _GOES for letter in shown)):
        return True
    first, last = (np.arctan2(*(lane.centre[end + 1] - lane.centre[end])[::-1]) for end in (0, -2))
    if abs(float(wrap(last - first))) > TURNED_RAD:
        return True
    if table is None or lane.id not in table.links:
        return lane.junction or (table is None and bool(met_by(road, lane.id)))
    return bool(table.gives_way.get(table.links[lane.id]))


def _is_anybody_ahead(drive: AgentDrive, at: int, step: int, reach: float) -> bool:
    """Whether another is in its way ahead, or is going to be."""
    tracks, agents, own = drive.tracks, drive.scenario.agents, drive.agent
    there = tracks.valid[:, step] & (np.arange(len(agents)) != own)
    length, width = np.array([(one.length, one.width) for one in agents]).T
    yaw = float(drive.yaw[at])
    dx, dy = tracks.x[:, step] - tracks.x[own, step], tracks.y[:, step] - tracks.y[own, step]
    ahead, left = ahead_and_left(np, dx, dy, yaw)
    turn = tracks.yaw[:, step] - yaw
    room = breadth(np, turn, 0.5 * length, 0.5 * width) + 0.5 * width[own] + _ASIDE_M
    then = left + _COMES_S * tracks.speed[:, step] * np.sin(turn)
    in_way = (np.minimum(left, then) < room) & (np.maximum(left, then) > -room)
    return bool((there & (ahead > 0.0) & (ahead < reach + 0.5 * length) & in_way).any())
