"""A suite that grows like a fuzzer's corpus: time goes to the least explored windows, and new crashes are added.

`intake` decides what is new. Every window is noted when it is done, so a killed run loses only the windows in work.
"""

import os
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import count

from regents_cosim.campaign.explored import ExploredFile, kind_by_tags, kind_of
from regents_cosim.campaign.intake import AddedCrash, SuiteIntake
from regents_cosim.campaign.window_job import AttackRun, crashes_of, failures_of
from regents_cosim.cases.content_hash import content_hash
from regents_cosim.scenario import Scenario

_OLD_ROUNDS = 2  # this many rounds in a row without a new window: the traffic holds no more

# gives the windows of a round, counted from 0; empty when the traffic is used up
Record = Callable[[int], Sequence[Scenario]]


@dataclass
class Growth:
    """The results of one run."""

    added: list[AddedCrash] = field(default_factory=list)
    windows: int = 0
    crashes: int = 0  # found crashes, including known ones
    used_up: bool = False  # it ended early because there are no more windows
    errors: list[str] = field(default_factory=list)  # failures of the planner


@dataclass(frozen=True)
class Budget:
    """A time limit: no window begins after it, but a window in work is finished."""

    ends_s: float

    @classmethod
    def of(cls, minutes: float) -> "Budget":
        """A limit that lies `minutes` from now."""
        return cls(time.monotonic() + 60.0 * minutes)

    @property
    def is_spent(self) -> bool:
        """Whether the time is over."""
        return time.monotonic() >= self.ends_s


@dataclass(frozen=True)
class GrowingSuite:
    """A suite with the settings by which it grows."""

    intake: SuiteIntake
    explored: ExploredFile
    run: AttackRun

    def grow(self, traffic: str, record: Record, budget: Budget) -> Growth:
        """Attack windows of `traffic` until time or windows run out; `record` gives the windows of a round."""
        growth, without = Growth(), 0
        for number in count(self.explored.run.rounds.get(traffic, 0)):
            if budget.is_spent:
                break
            windows = record(number)
            left = {digest: one for one in windows if (digest := content_hash(one)) not in self.explored.run.windows}
            without = 0 if left else without + 1
            if not windows or without >= _OLD_ROUNDS:
                growth.used_up = True
                break
            self._attack(left, budget, growth)
            if left:  # the time was up
                break
            self.explored.end_round(traffic, number + 1)
        return growth

    def _attack(self, left: dict[str, Scenario], budget: Budget, growth: Growth) -> None:
        """Attack windows, the least explored first, and remove finished ones from `left`."""
        # so that each window is chosen only when its turn comes
        run = replace(self.run, batch=min(self.run.batch, os.cpu_count() or 1))
        begun: deque[tuple[str, str]] = deque()
        for cases in run.attack(self._chosen(dict(left), budget, begun)):
            digest, kind = begun.popleft()
            self._take(cases, growth)
            self.explored.note(digest, kind)
            del left[digest]

    def _chosen(self, left: dict[str, Scenario], budget: Budget, begun: deque[tuple[str, str]]) -> Iterator[Scenario]:
        """Choose windows one by one, always of the surroundings with the fewest attacked windows and filled cells."""
        kinds = {digest: kind_of(window) for digest, window in left.items()}
        tried = self.explored.counts()
        while left and not budget.is_spent:
            filled = Counter(kind_by_tags(crash.tags) for crash in self.intake.archive.elites.values())
            digest = min(left, key=lambda one: (tried[kinds[one]] + filled[kinds[one]], one))
            tried[kinds[digest]] += 1
            begun.append((digest, kinds[digest]))
            yield left.pop(digest)

    def _take(self, cases: Sequence[Scenario], growth: Growth) -> None:
        """Add the new crashes of one window to the suite."""
        growth.windows += 1
        growth.errors += [case.attack.planner_error for case in failures_of(cases) if case.attack]
        crashes = crashes_of(cases)
        growth.crashes += len(crashes)
        growth.added += self.intake.take(crashes)
