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
    """Closed loops of a planner, at most `most` in each scenario; 0: any number.

    Where one search asks for the same drive again, the answer is the one it had.
    """

    def __init__(self, run: RunClosedLoops, most: int) -> None:
        self._run, self._most = run, most
        self._made: dict[int, int] = defaultdict(int)
        self._driven: dict[int, dict[_Key, tuple[DriveRequest, ClosedLoopDrive]]] = defaultdict(dict)

    def __call__(self, requests: Sequence[DriveRequest]) -> list[ClosedLoopDrive | DriveError]:
        """Answer requests in their order."""
        keys = [_key(request) for request in requests]
        known = [self._driven[id(one.scenario)].get(key) for one, key in zip(requests, keys, strict=True)]
        fresh = [index for index, one in enumerate(known) if one is None]
        answers: list[ClosedLoopDrive | DriveError] = [ClosedLoopDrive(one[1].ego) for one in known if one]
        for index, answer in zip(fresh, self._run([requests[index] for index in fresh]), strict=True):
            request = requests[index]
            answers.insert(index, answer)
            self._made[id(request.scenario)] += 1
            if isinstance(answer, ClosedLoopDrive):
                self._driven[id(request.scenario)][keys[index]] = request, answer
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
            for request, driven in self._driven[id(scenario)].values()
            if request.job.searched is job.searched or request.unattacked
        ]
        return driven_steps(drives, who, np.asarray(job.world.valid)[who], job.world.dt)


_ANY_NUMBER = 10**9
_Key = tuple[int, bytes]


def _key(request: DriveRequest) -> _Key:
    """What a drive depends on: the search that asks for it, and the tracks of the others."""
    tracks = (np.asarray(values).tobytes() for values in jax.tree.leaves(request.traffic.background))
    return id(request.job.searched), b"".join(tracks)
