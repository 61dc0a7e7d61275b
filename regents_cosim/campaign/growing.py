"""A suite that grows like a fuzzer's corpus: a time is spent on what is least explored, and what is new is added.

New is a crash in a cell of the map of behaviours that is empty, or one that is plainer or gentler than the best there.
What is in the suite stays: its outcome may have been accepted. Every case is added whole or not at all, and every
window is noted when it is done, so that a session that is killed loses the windows that it was at, and nothing else.
"""

import os
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path

from regents_cosim.archive.axes import Cell
from regents_cosim.archive.crash import Crash, crash_of
from regents_cosim.archive.elites import Archive
from regents_cosim.campaign.attack_run import STILL
from regents_cosim.campaign.explored import ExploredFile, kind_by_tags, kind_of
from regents_cosim.campaign.window_job import AttackRun, Still, crashes_of, failures_of
from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_header
from regents_cosim.cases.header import HEADER
from regents_cosim.cases.manifest import add_case, load_manifest
from regents_cosim.replays.replay import replay_each
from regents_cosim.scenario import Scenario
from regents_cosim.system.atomic import write_atomic
from regents_cosim.system.interruption import keep, made_whole

_HASH = 8  # letters of it, behind a name that is taken
_OLD_ROUNDS = 2  # without a window that is new, one after the other: the traffic holds no more

Record = Callable[[int], Sequence[Scenario]]  # the windows of a round, counted from 0; none where there are no more


@dataclass(frozen=True)
class Added:
    """A crash that was added."""

    crash: Crash
    cell: Cell
    why: str  # new cell, plainer or gentler
    than: str  # the case that was the best of its cell; empty for a new cell


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

    folder: Path
    archive: Archive  # its crashes
    explored: ExploredFile
    run: AttackRun
    still: Still
    copy: Callable[[Scenario], Path] | None = None  # saves what is added in a second place; its folder there

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
            filled = Counter(kind_by_tags(crash.tags) for crash in self.archive.elites.values())
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
        new = [case for case in crashes if (crash := crash_of(case)) and self.archive.improves(crash)]
        confirmed = {one.case for one in replay_each(new, "sumo") if one.verified} if self.run.verify and new else set()
        for case in new:
            if case.id in confirmed or not self.run.verify:
                self._add(case, growth)

    def _add(self, case: Scenario, growth: Growth) -> None:
        """Add a crash, unless another one of its window has just filled its cell with a better one."""
        case = self._with_free_name(case)
        crash = crash_of(case)
        why = self.archive.improves(crash) if crash else ""
        if crash is None or not why:
            return
        best = self.archive.elite(self.archive.axes.cell(crash))
        with made_whole():
            folder = add_case(case, self.folder, replace(load_manifest(self.folder), cases=()))
            growth.added.append(Added(crash, self.archive.add(crash), why, best.case if best else ""))
        keep(f"cases added to {self.folder}: {len(growth.added)}")
        places = [folder, *([self.copy(case)] if self.copy else [])]
        for place in places if self.run.pictures else []:
            write_atomic(place / STILL, self.still(case))

    def _with_free_name(self, case: Scenario) -> Scenario:
        """With the hash behind its name, where the suite has another case of that name, which stays."""
        digest = content_hash(case)
        there = self.folder / case.id
        if not (there / HEADER).is_file() or load_header(there).hash == digest:
            return case
        return replace(case, id=f"{case.id}-{digest[:_HASH]}")
