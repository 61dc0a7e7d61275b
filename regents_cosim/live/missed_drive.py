"""A drive that did not crash the ego as wanted, and with which later looks go on."""

import copy
from dataclasses import dataclass, replace

from regents_cosim.attacks.sampled_search import Sampling
from regents_cosim.attacks.starts import Start
from regents_cosim.live.moments import DT_S, Moment
from regents_cosim.live.plan import Plan


@dataclass(frozen=True, eq=False)
class MissedDrive:
    """Its changes are tried first, then those of what is predicted of its vehicle by then."""

    plan: Plan
    moment: Moment  # at which it was found
    agent: int  # in that moment
    sampling: Sampling | None = None  # the changes that are being tried
    of_predicted: bool = False  # the changes of the drive have been tried

    @classmethod
    def of(cls, moment: Moment, agent: int, start: Start) -> "MissedDrive":
        """That of an agent, of which nothing has been tried."""
        name, begun = moment.scenario.agents[agent].id, moment.traffic.time_s
        drive = start.x, start.y, start.yaw, start.speed
        return cls(Plan(name, begun, *drive, meets_s=begun + start.meets * DT_S), moment, agent)

    @property
    def has_begun(self) -> bool:
        """Whether changes have been tried."""
        return self.sampling is not None or self.of_predicted

    def copied(self) -> "MissedDrive":
        """One whose changes are tried independently of those of this one."""
        return replace(self, sampling=copy.deepcopy(self.sampling))

    def after(self, sampling: Sampling, accepted: bool) -> "MissedDrive | None":
        """What is left to try after some changes, of which one was `accepted` but was no plan, or none was."""
        if not accepted and not sampling.is_over:
            return replace(self, sampling=sampling)
        return None if self.of_predicted else replace(self, sampling=None, of_predicted=True)
