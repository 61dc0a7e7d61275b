"""The drives of a planner that is asked now and then: counted, bounded, and remembered to rank further drives."""

from collections import Counter, defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np

from regents_cosim.attacks.descent.pursuit import ClosedLoopDrive, DriveRequest, RunClosedLoops
from regents_cosim.attacks.job import SearchJob
from regents_cosim.attacks.sampling.ego_as_driven import DrivenSteps, PastDrive, driven_steps
from regents_cosim.errors import DriveError
from regents_cosim.scenario.scenario import Scenario


class PlannerDrives:
    """Closed loops of a planner, at most `most` in each scenario; 0: any number.

    Where one search asks for the same drive again, the answer is the one it had.
    """

    def __init__(self, run: RunClosedLoops, most: int) -> None:
        self._run, self._most = run, most
        self._made: dict[Scenario, int] = defaultdict(int)
        self._driven: dict[Scenario, list[_Driven]] = defaultdict(list)
        self._near: dict[int, _Near] = {}

    def __call__(self, requests: Sequence[DriveRequest]) -> list[ClosedLoopDrive | DriveError]:
        """Answer requests in their order."""
        known = [self._known(request) for request in requests]
        fresh = [index for index, one in enumerate(known) if one is None]
        answers: list[ClosedLoopDrive | DriveError] = [ClosedLoopDrive(one.ego) for one in known if one]
        for index, answer in zip(fresh, self._run([requests[index] for index in fresh]), strict=True):
            request = requests[index]
            answers.insert(index, answer)
            self._made[request.scenario] += 1
            if isinstance(answer, ClosedLoopDrive):
                self._driven[request.scenario].append(_Driven(request, _tracks(request), answer))
        return answers

    def _known(self, request: DriveRequest) -> ClosedLoopDrive | None:
        """The drive of the same search among the same tracks."""
        tracks, searched = _tracks(request), request.job.searched
        past = self._driven[request.scenario]
        return next((one.drive for one in past if one.request.job.searched is searched and one.tracks == tracks), None)

    def made(self, scenario: Scenario) -> int:
        """The number of drives so far."""
        return self._made[scenario]

    def left(self, scenario: Scenario) -> int:
        """The number of drives that may still be made."""
        return max(self._most - self.made(scenario), 0) if self._most else _ANY_NUMBER

    def shares(self, scenarios: Sequence[Scenario]) -> dict[Scenario, int]:
        """The number of drives for each of several moves that are made together, by the scenario of each."""
        return {scenario: max(self.left(scenario) // number, 1) for scenario, number in Counter(scenarios).items()}

    def near(self, scenario: Scenario, job: SearchJob) -> DrivenSteps:
        """The steps of the drives against the adversary of `job`, and of the unattacked one."""
        drives = [
            past
            for past in self._driven[scenario]
            if past.request.job.searched is job.searched or past.request.unattacked
        ]
        seen = self._near.get(id(job.searched))
        if seen is None or seen.drives != len(drives):
            seen = self._near[id(job.searched)] = _Near(job, len(drives), _steps(drives, job))
        return seen.steps


_ANY_NUMBER = 10**9


class _Driven(NamedTuple):
    """A drive that was made, what asked for it, and the tracks of the others."""

    request: DriveRequest
    tracks: bytes
    drive: ClosedLoopDrive


def _tracks(request: DriveRequest) -> bytes:
    return b"".join(np.asarray(values).tobytes() for values in jax.tree.leaves(request.traffic.background))


class _Near(NamedTuple):
    """The steps of the drives for a search."""

    job: SearchJob  # kept, so that no other object gets its number
    drives: int
    steps: DrivenSteps


def _steps(drives: Sequence[_Driven], job: SearchJob) -> DrivenSteps:
    who = int(np.argmax(np.asarray(job.searched.candidate)))
    past = [
        PastDrive(
            one.drive.ego.motion,
            one.drive.ego.controls,
            jax.tree.map(lambda values: np.asarray(values)[who], one.request.traffic.background),
        )
        for one in drives
    ]
    return driven_steps(past, who, np.asarray(job.world.valid)[who], job.world.dt)
