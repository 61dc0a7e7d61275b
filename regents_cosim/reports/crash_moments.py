"""Moments of a crash that reports tell: when the adversary enters the ego's path, how drivers brake, who gave no way.

From the first of them on people expect a driver to react.
"""

from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Float, Int

from regents_cosim.geometry.boxes import corners
from regents_cosim.norms.limits import INTRUSION_M
from regents_cosim.scenario.attack_record import Collision
from regents_cosim.scenario.scenario import Scenario, Tracks
from regents_cosim.verdicts.careful.evasion import room_m
from regents_cosim.verdicts.law.drive import AgentDrive, agent_drive
from regents_cosim.verdicts.law.priority import gives_no_way

_BRAKES_M_S2 = 1.0  # to lose less speed is not to brake
_PAUSE_S = 0.5  # to let go for a shorter time does not end it
_SEEN_M_S = 0.5 / 3.6  # a smaller loss of speed does not show in whole km/h
_SAME_M_S2 = 0.05  # the hardest moment is the first that reads the same
_WIDTH_M = 3.2  # of the line of one who came along no lane
_ON_FOOT_M = 1.6


class Braking(NamedTuple):
    """A time in which a vehicle brakes."""

    since: int  # its first step
    until: int  # the step after its last
    most_m_s2: float
    hardest: int  # the step at which `most_m_s2` is reached


def last_braking(speed: Float[np.ndarray, " step"], dt: float) -> Braking | None:
    """The last time in which a vehicle with these speeds [m/s] brakes; None where it never does."""
    lost = _lost(speed, dt)
    steps = np.flatnonzero(lost > _BRAKES_M_S2)
    if not len(steps):
        return None
    return _over(lost, np.split(steps, np.flatnonzero(np.diff(steps) * dt > _PAUSE_S) + 1)[-1])


def _over(lost: Float[np.ndarray, " change"], steps: Int[np.ndarray, " braking"]) -> Braking:
    most = float(lost[steps].max())
    return Braking(int(steps[0]), int(steps[-1]) + 1, most, int(steps[lost[steps] >= most - _SAME_M_S2][0]))


def braking_line(scenario: Scenario, ego: Tracks | None, hit: Collision | None, with_careful: bool = True) -> str:
    """How an ego on the tracks `ego` brakes before its collision, beside how the careful driver of the case does.

    Empty where there is neither.
    """
    said = [] if ego is None or hit is None else [f"the ego {_of_ego(ego.speed[0, : hit.step + 1], scenario.dt)}"]
    if with_careful and scenario.evasion is not None:
        said.append(f"a careful driver {_of_careful(scenario)}")
    return f"Braking: {'; '.join(said)}." if said else ""


def _of_ego(speed: Float[np.ndarray, " step"], dt: float) -> str:
    last = last_braking(speed, dt)
    if last is not None:
        ends = f" to {last.until * dt:.1f} s" if last.until < len(speed) - 1 else ""
        return f"from {last.since * dt:.1f} s{ends}, {_hardest(last, dt)}"
    slower = float(speed.max() - speed[-1]) > _SEEN_M_S
    return f"hardly, with no more than {_lost(speed, dt).max():.1f} m/s²" if slower else "not at all"


def _of_careful(scenario: Scenario) -> str:
    """The words for the careful driver, who begins when its verdict says so, also where the ego brakes already."""
    drive, since, dt, room = scenario.evasion, scenario.evades_from, scenario.dt, room_m(scenario)
    assert drive is not None
    assert since is not None
    assert scenario.judgement is not None
    braking = _over(_lost(drive.speed[0], dt), np.arange(since, drive.steps - 1))
    leaves = "" if room is None else f", which leaves {_apart(room)} between the two"
    return f"from {scenario.judgement.evades_s:.1f} s, {_hardest(braking, dt)}{leaves}"


def _hardest(braking: Braking, dt: float) -> str:
    if braking.most_m_s2 < _SAME_M_S2:
        return "standing still"
    later = f" at {braking.hardest * dt:.1f} s" if braking.hardest > braking.since else ""
    return f"with up to {braking.most_m_s2:.1f} m/s²{later}"


def _apart(metres: float) -> str:
    return f"{metres:.1f} m" if metres >= 0.1 else "less than 0.1 m"


def _lost(speed: Float[np.ndarray, " step"], dt: float) -> Float[np.ndarray, " step-1"]:
    """The speed that is lost from each step to the next [m/s²]."""
    return -np.diff(speed) / dt


def enters_lane(scenario: Scenario) -> int | None:
    """The step at which the road user that the ego hits is 0.3 m inside the lanes of the ego.

    It then stays there until the two collide. None without a collision, where it is in these lanes all along or comes
    from behind in them, and where the ego drives along no lanes that the map knows.
    """
    hit = scenario.collision
    if hit is None or hit.collision_type == "rear_end_by_adversary":
        return None
    other = scenario.index(hit.agent)
    lanes = {lane.id: lane for lane in agent_drive(scenario, 0, hit.step).front_lanes if lane is not None}
    inner = [lane.line.buffer(max(0.5 * lane.width - INTRUSION_M, 0.0), cap_style="flat") for lane in lanes.values()]
    its = agent_drive(scenario, other, hit.step)
    inside = np.asarray(shapely.intersects(shapely.union_all(inner), shapely.polygons(np.asarray(corners(its.box)))))
    outside = np.flatnonzero(~inside)
    if not len(outside) or outside[-1] == len(inside) - 1:
        return None
    return int(its.steps[outside[-1] + 1])


class GiveWayLine(NamedTuple):
    """Where a road user had to give way."""

    agent: int  # index of the road user
    middle: Float[np.ndarray, " 2"]  # [m]
    heading: float  # [rad] in which the road user passes the line
    width: float  # [m]


def give_way_line(attacked: Scenario, other: int, last: int) -> GiveWayLine | None:
    """The line that the ego or agent `other` passed up to step `last` though it had to give way to the other one.

    None where neither had to, or the map does not tell.
    """
    ego, partner = (agent_drive(attacked, agent, last) for agent in (0, other))
    for drive, its in ((ego, partner), (partner, ego)):
        act = gives_no_way(drive, its)
        if act is not None:
            return _line(drive, act.step)
    return None


def _line(drive: AgentDrive, step: int) -> GiveWayLine:
    """The end of the lane that it left at `step`; where it came along none, its front then."""
    for at, before, _ in drive.entered:
        if at == step and not before.junction:
            ahead = before.centre[-1] - before.centre[-2]
            return GiveWayLine(drive.agent, before.centre[-1], float(np.arctan2(*ahead[::-1])), before.width)
    index = int(np.searchsorted(drive.steps, step))
    width = _ON_FOOT_M if drive.on_foot else _WIDTH_M
    return GiveWayLine(drive.agent, drive.front[index], float(drive.yaw[index]), width)
