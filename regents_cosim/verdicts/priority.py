"""Failure to give way: one of two in a junction had to let the other pass, by the network's own right of way."""

from typing import NamedTuple

from regents_cosim.maps.roadmap import Lane
from regents_cosim.scenario import RED
from regents_cosim.verdicts.drive import AgentDrive, OffendingAct
from regents_cosim.verdicts.right_of_way import priorities

_LATELY_S = 6.0  # who came into the junction longer ago was not to wait any more
_FREE, _STOP = "G", RED  # letters: goes first; may not go at all


class _Movement(NamedTuple):
    step: int  # at which its front passed the stop line
    approach: Lane
    lane: Lane  # inside the junction


def gives_no_way(drive: AgentDrive, partner: AgentDrive | None) -> OffendingAct | None:
    """It went into the junction though it had to give way; the amount is how long before the crash."""
    table = priorities(drive.scenario.road)
    if table is None or partner is None:
        return None
    mine, theirs = _movement(drive), _movement(partner)
    if mine is None or theirs is None or not table.must_yield(mine.lane.id, theirs.lane.id):
        return None
    if _letter(drive, mine) in _FREE or _letter(partner, theirs) in _STOP:
        return None
    return OffendingAct(mine.step, drive.last - mine.step + 1, (drive.last - mine.step + 1) * drive.scenario.dt)


def _movement(drive: AgentDrive) -> _Movement | None:
    """The way through a junction that it took last, if it is still on it or was a few seconds ago."""
    first, last = drive.front_lanes[0], drive.front_lanes[-1]
    entries = [_Movement(*one) for one in drive.entered if one[2].junction and not one[1].junction]
    if not entries:
        return _begun_inside(drive, first) if first is not None and first.junction else None
    still = last is not None and last.junction
    return entries[-1] if still or entries[-1].step >= drive.last - _LATELY_S / drive.scenario.dt else None


def _begun_inside(drive: AgentDrive, lane: Lane) -> _Movement | None:
    """The movement of who is inside a junction when first seen."""
    road = drive.scenario.road
    before = next((link.source for link in road.connections if link.target == lane.id), None)
    return None if before is None else _Movement(int(drive.steps[0]), road.lane[before], lane)


def _letter(drive: AgentDrive, movement: _Movement) -> str:
    """What the light of a movement showed when it began; - where it has none."""
    lights = {light.id: light for light in drive.scenario.signals}
    for link in drive.scenario.road.exits[movement.approach.id]:
        if link.target == movement.lane.id and link.signal in lights:
            return lights[link.signal].letters(movement.step)[link.link]
    return "-"
