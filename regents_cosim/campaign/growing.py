"""A suite that grows like a fuzzer's corpus: a time is spent on what is least explored, and what is new is added.

What is new says `intake`. Every window is noted when it is done, so that a session that is killed loses the windows
that it was at, and nothing else.
"""

import os
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import count

from regents_cosim.campaign.explored import ExploredFile, kind_by_tags, kind_of
from regents_cosim.campaign.intake import Added, SuiteIntake
from regents_cosim.campaign.window_job import AttackRun, crashes_of, failures_of
from regents_cosim.cases.content_hash import content_hash
from regents_cosim.scenario import Scenario

_OLD_ROUNDS = 2  # without a window that is new, one after the other: the traffic holds no more

Record = Callable[[int], Sequence[Scenario]]  # the windows of a round, counted from 0; none where there are no more


@dataclass
class Growth:
    """What a session did."""

    added: list[Added] = field(default_factory=list)
    windows: int = 0
    crashes: int = 0  # found, the known ones included
    used_up: bool = False  # it ended before its time: there are no more windows
    errors: list[str] = field(default_factory=list)  # of windows in which the planner failed


@dataclass(frozen=True)
class Budget:
    """Until when windows are begun; one that has begun is finished."""

    ends_s: float

    @classmethod
    def of(cls, minutes: float) -> "Budget":
        """From now on."""
        return cls(time.monotonic() + 60.0 * minutes)

    @property
    def is_spent(self) -> bool:
        """Whether the time is over."""
        return time.monotonic() >= self.ends_s


@dataclass(frozen=True)
class GrowingSuite:
    """A suite, and how it is made to grow."""

    intake: SuiteIntake
    explored: ExploredFile
    run: AttackRun

    def grow(self, traffic: str, record: Record, budget: Budget) -> Growth:
        """Attack windows until the time is over or there are no more. `traffic`: what they are recorded from."""
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
            if left:  # the time is over
                break
            self.explored.end_round(traffic, number + 1)
        return growth

    def _attack(self, left: dict[str, Scenario], budget: Budget, growth: Growth) -> None:
        """Attack windows, the least explored first; those that are done are taken out of `left`."""
        run = replace(self.run, batch=min(self.run.batch, os.cpu_count() or 1))  # none is chosen before its turn
        begun: deque[tuple[str, str]] = deque()
        for cases in run.attack(self._chosen(dict(left), budget, begun)):
            digest, kind = begun.popleft()
            self._take(cases, growth)
            self.explored.note(digest, kind)
            del left[digest]

    def _chosen(self, left: dict[str, Scenario], budget: Budget, begun: deque[tuple[str, str]]) -> Iterator[Scenario]:
        """The next is one with the kind of surroundings of which fewest windows were attacked, and cells are filled."""
        kinds = {digest: kind_of(window) for digest, window in left.items()}
        tried = self.explored.counts()
        while left and not budget.is_spent:
            filled = Counter(kind_by_tags(crash.tags) for crash in self.intake.archive.elites.values())
            digest = min(left, key=lambda one: (tried[kinds[one]] + filled[kinds[one]], one))
            tried[kinds[digest]] += 1
            begun.append((digest, kinds[digest]))
            yield left.pop(digest)

    def _take(self, cases: Sequence[Scenario], growth: Growth) -> None:
        """Add what is new of one window's results."""
        growth.windows += 1
        growth.errors += [case.attack.planner_error for case in failures_of(cases) if case.attack]
        crashes = crashes_of(cases)
        growth.crashes += len(crashes)
        growth.added += self.intake.take(crashes)
