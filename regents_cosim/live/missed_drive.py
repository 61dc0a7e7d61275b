"""A drive that did not crash the ego as wanted, from which the search continues."""

from dataclasses import dataclass

from regents_cosim.attacks.starts import Start
from regents_cosim.live.moments import DT_S, Moment
from regents_cosim.live.plan import Plan


@dataclass(frozen=True, eq=False)
class MissedDrive:
    """The drive, the moment in which it was tried, and its agent."""

    start: Start
    moment: Moment
    agent: int
    may_sample: bool  # whether its changes are sampled in the next step; else the next search descends from it

    @property
    def name(self) -> str:
        """The id of the vehicle."""
        return self.moment.scenario.agents[self.agent].id

    @property
    def plan(self) -> Plan:
        """The drive as a plan."""
        begun, start = self.moment.traffic.time_s, self.start
        drive = start.x, start.y, start.yaw, start.speed
        return Plan(self.name, begun, *drive, meets_s=begun + start.meets * DT_S)
