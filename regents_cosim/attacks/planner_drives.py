"""The drives of a planner that is asked now and then: counted, bounded, and remembered to rank further drives."""

from collections import defaultdict
from collections.abc import Sequence

import jax
import numpy as np

from regents_cosim.attacks.descent.pursuit import ClosedLoopDrive, DriveRequest, RunClosedLoops
from regents_cosim.attacks.job import SearchJob
from regents_cosim.attacks.sampling.ego_as_driven import DrivenSteps, PastDrive, driven_steps
from regents_cosim.errors import DriveError
from regents_cosim.scenario import Scenario


class PlannerDrives:
    """Closed loops of a planner, at most `most` in each scenario; 0: any number."""

    def __init__(self, run: RunClosedLoops, most: int) -> None:
        self._run, self._most = run, most
        self._made: dict[int, int] = defaultdict(int)
        self._driven: dict[int, list[tuple[DriveRequest, ClosedLoopDrive]]] = defaultdict(list)

    def __call__(self, requests: Sequence[DriveRequest]) -> list[ClosedLoopDrive | DriveError]:
        """Answer requests in their order."""
        answers = self._run(requests)
        for request, answer in zip(requests, answers, strict=True):
            self._made[id(request.scenario)] += 1
            if isinstance(answer, ClosedLoopDrive):
                self._driven[id(request.scenario)].append((request, answer))
        return answers

    def made(self, scenario: Scenario) -> int:
        """The number of drives so far."""
        return self._made[id(scenario)]

    def left(self, scenario: Scenario) -> int:
        """The number of drives that may still be made."""
        return max(self._most - self.made(scenario), 0) if self._most else _ANY_NUMBER

    def shares(self, scenarios: Sequence[Scenario]) -> list[int]:
        """The number of drives for each of several moves that are made together, given the scenario of each."""
        ids = [id(scenario) for scenario in scenarios]
        return [max(self.left(scenario) // ids.count(id(scenario)), 1) for scenario in scenarios]

    def near(self, scenario: Scenario, job: SearchJob) -> DrivenSteps:
        """The steps of the drives against the adversary of `job`, and of the unattacked one."""
        who = int(np.argmax(np.asarray(job.searched.candidate)))
        drives = [
            PastDrive(
                driven.ego.motion,
                driven.ego.controls,
                jax.tree.map(lambda values: np.asarray(values)[who], request.traffic.background),
            )
            for request, driven in self._driven[id(scenario)]
            if request.job.searched is job.searched or request.unattacked
        ]
        return driven_steps(drives, who, np.asarray(job.world.valid)[who], job.world.dt)


_ANY_NUMBER = 10**9
