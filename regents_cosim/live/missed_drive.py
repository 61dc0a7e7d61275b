"""A drive that did not crash the ego as wanted, and with which the search goes on."""

from dataclasses import dataclass

from regents_cosim.attacks.starts import Start
from regents_cosim.live.moments import DT_S, Moment
from regents_cosim.live.plan import Plan


@dataclass(frozen=True, eq=False)
class MissedDrive:
    """Where the search went from, in which moment, and for which of its agents."""

    start: Start
    moment: Moment
    agent: int
    may_sample: bool  # changes of it, in the step after the look; else the next look descends from it

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
