"""Find the line at which one of the two in a crash had to give way to the other, to show it."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from regents_cosim.scenario import Scenario
from regents_cosim.verdicts.law.drive import AgentDrive, agent_drive
from regents_cosim.verdicts.law.priority import gives_no_way

_WIDTH_M = 3.2  # of the line of one who came along no lane
_ON_FOOT_M = 1.6


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
