"""Find a failure to give way: by the right of way of SUMO's network, or by lights, signs and turns on other maps."""

from typing import NamedTuple

import numpy as np
from shapely import Point

from regents_cosim.maps.right_of_way import priorities
from regents_cosim.maps.roadmap import Lane
from regents_cosim.norms.limits import ALONG_RAD, HEAD_ON_SHARE
from regents_cosim.scenario.scenario import RED
from regents_cosim.verdicts.law.drive import AgentDrive, OffendingAct
from regents_cosim.verdicts.law.meeting_ways import LATELY_S, letter_into, who_yields
from regents_cosim.verdicts.law.walking_ground import ground_of, steppings

_FREE, _STOP = "G", RED  # letters: goes first; must not go at all


class _Movement(NamedTuple):
    step: int  # at which its front passed the stop line, or it stepped onto the crossing
    lane: str  # inside the junction
    letter: str  # shown by its light then; "-" without a light


def gives_no_way(drive: AgentDrive, partner: AgentDrive | None) -> OffendingAct | None:
    """It entered the junction although it had to give way; amount: how long before the crash.

    A crossing is a way through the junction like any other: by its rows cars give way to pedestrians on it, or the
    other way round.
    """
    step = None if partner is None else _failed_at(drive, partner)
    if step is None:
        return None
    return OffendingAct(step, drive.last - step + 1, (drive.last - step + 1) * drive.scenario.dt)


def knows_who_gives_way(one: AgentDrive, two: AgentDrive) -> bool:
    """Whether it is known who of two that met had to give way; it does not matter unless their ways crossed."""
    if one.scenario.road.lanes and not (one.on_foot or two.on_foot or _ways_crossed(one, two)):
        return True
    table = priorities(one.scenario.road)
    if table is not None:
        return all(move is None or move.lane in table.links for move in (_movement(one), _movement(two)))
    if one.on_foot or two.on_foot:
        return _walker_goes_first(one if one.on_foot else two) is not None
    return _on_lanes(one, two) and who_yields(one, two)[0] is not None


def _failed_at(drive: AgentDrive, partner: AgentDrive) -> int | None:
    """The step at which it went on although it had to give way; None where it did not."""
    table = priorities(drive.scenario.road)
    if table is None and partner.on_foot:
        crossed = _on_crossing(partner) if _walker_goes_first(partner) else None
        return None if crossed is None else max(crossed.step, int(drive.steps[0]))
    if table is None:
        if not _on_lanes(drive, partner) or not _ways_crossed(drive, partner):
            return None
        who, mine, _ = who_yields(drive, partner)
        return mine.step if who == "first" else None
    mine, theirs = _movement(drive), _movement(partner)
    if mine is None or theirs is None or not table.must_yield(mine.lane, theirs.lane):
        return None
    return None if mine.letter in _FREE or theirs.letter in _STOP else mine.step


def _walker_goes_first(walker: AgentDrive) -> bool | None:
    """Whether drivers give way to a pedestrian by the map of a log, on a crossing without lights; None: not known.

    Off all crossings `steps_out` is the measure. Sources: Vienna Convention on Road Traffic (1968), art. 21(2)(b);
    Uniform Vehicle Code (2000), 11-502.
    """
    ground, scenario = ground_of(walker.scenario), walker.scenario
    crossed = _on_crossing(walker)
    if ground is None or crossed is None:
        return None if ground is None else False
    area = next(way.area for way in ground.crossings if way.id == crossed.lane)
    road = scenario.road
    over = [road.lanes[index].id for index in road.centre_lines.query(area, predicate="intersects").tolist()]
    lit = any(link.signal for name in over for link in (*road.entries[name], *road.exits[name]))
    return True if scenario.signals and not lit else None


def _on_lanes(one: AgentDrive, two: AgentDrive) -> bool:
    return bool(one.scenario.road.lanes) and not (one.on_foot or two.on_foot)


def _ways_crossed(one: AgentDrive, two: AgentDrive) -> bool:
    """Whether one of two drives went across the other in the last seconds, or they met head-on on no oncoming lane."""
    since = one.last - LATELY_S / one.scenario.dt
    _, first, second = np.intersect1d(one.steps[one.steps >= since], two.steps, return_indices=True)
    first = first + int(np.searchsorted(one.steps, since))
    along = np.cos(one.yaw[first] - two.yaw[second])
    keep_sides = all(drive.oncoming_share[-1] <= HEAD_ON_SHARE for drive in (one, two))
    return bool((np.abs(along) < np.cos(ALONG_RAD)).any() or (keep_sides and along[-1] < 0.0))


def _movement(drive: AgentDrive) -> _Movement | None:
    return _on_crossing(drive) if drive.on_foot else _through_junction(drive)


def _on_crossing(drive: AgentDrive) -> _Movement | None:
    """The movement over the crossing that it is on."""
    ground = ground_of(drive.scenario)
    here = [] if ground is None else [one for one in ground.crossings if one.area.covers(Point(drive.centre[-1]))]
    if ground is None or not here:
        return None
    came = [step for step, crossing in steppings(ground, drive) if crossing is here[0]]
    step = came[-1] if came else int(drive.steps[0])
    return _Movement(step, here[0].id, drive.scenario.shows(here[0].signal, here[0].link, step))


def _through_junction(drive: AgentDrive) -> _Movement | None:
    """The way through a junction that it took last, if it is still on it or was a few seconds ago."""
    first, last = drive.front_lanes[0], drive.front_lanes[-1]
    entries = [one for one in drive.entered if one[2].junction and not one[1].junction]
    if not entries:
        return _begun_inside(drive, first) if first is not None and first.junction else None
    still = last is not None and last.junction
    lately = still or entries[-1][0] >= drive.last - LATELY_S / drive.scenario.dt
    return _passing(drive, *entries[-1]) if lately else None


def _begun_inside(drive: AgentDrive, lane: Lane) -> _Movement | None:
    """The movement of an agent that is inside a junction when first seen."""
    road = drive.scenario.road
    before = next((link.source for link in road.entries[lane.id]), None)
    return None if before is None else _passing(drive, int(drive.steps[0]), road.lane[before], lane)


def _passing(drive: AgentDrive, step: int, approach: Lane, lane: Lane) -> _Movement:
    """The movement from the lane `approach` into `lane` inside the junction at a step."""
    return _Movement(step, lane.id, letter_into(drive.scenario, lane, [approach], step))
