"""A suite that grows like a fuzzer's corpus: time goes to the least explored windows, and new crashes are added.

A crash is new if its cell of the map of behaviours is empty, or if it is plainer or gentler than the best one there.
Cases in the suite stay, as their outcome may have been accepted. Every case is added whole or not at all, and a known
case is not added again; every window is noted when it is done. So a killed run loses only the windows in work, and the
next one adds what is missing.
"""

import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import Any

import msgspec

from regents_cosim.attacks.attack import window_row
from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import STILL
from regents_cosim.cases.json_files import JSON_BYTES, SCHEMA
from regents_cosim.cases.manifest import load_manifest
from regents_cosim.checks.bounded import read_bounded
from regents_cosim.checks.names import require_inside
from regents_cosim.checks.typed_values import from_json
from regents_cosim.errors import CaseError, RegentsError
from regents_cosim.replays.holds import verified_only
from regents_cosim.runs.behaviour_map import NAMES, Archive, Cell, Crash, cell_of, crash_of
from regents_cosim.runs.window_job import AttackRun, Still, crashes_of
from regents_cosim.saving import add_case
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.short_repr import ShortRepr
from regents_cosim.system.data_frames import Tabular
from regents_cosim.system.files.atomic import explain_write, write_atomic
from regents_cosim.system.files.locks import writing
from regents_cosim.system.interruption import announce_kept, uninterrupted
from regents_cosim.system.progress import SILENT, Progress
from regents_cosim.system.workers import cores
from regents_cosim.tags.table import TAGS, tags_of

EXPLORED = "explored.json"
_AROUND = tuple(name for name, tag in TAGS.items() if tag.about in ("ego", "place", "lights", "density"))


class ExploredWindows(msgspec.Struct):
    """The windows that one planner was attacked in by one method."""

    planner: str
    method: str
    rounds: dict[str, int] = {}  # number of finished rounds of recording, by the traffic that is recorded
    windows: dict[str, str] = {}  # the surroundings of the ego, by the hash of the window


class _File(msgspec.Struct):
    schema: int = 1
    runs: dict[str, ExploredWindows] = {}


@dataclass(frozen=True)
class ExploredFile:
    """The file explored.json of a suite, for one run; other processes may let the suite grow meanwhile."""

    suite: Path
    key: str
    run: ExploredWindows  # what is known of this run

    def note(self, window: str, kind: str) -> None:
        """Note a finished window, and write the file."""
        self.run.windows[window] = kind
        self._save()

    def end_round(self, traffic: str, number: int) -> None:
        """Note how many rounds of some traffic are finished, and write the file."""
        self.run.rounds[traffic] = number
        self._save()

    def _save(self) -> None:
        """Add what is known to the file, which other processes may have written since, and learn what they noted."""
        with explain_write(self.suite), writing(self.suite):
            runs = _read_explored(self.suite).runs
            mine, there = self.run, runs.get(self.key)
            if there is not None:
                mine.windows |= there.windows
                mine.rounds |= {of: max(number, mine.rounds.get(of, 0)) for of, number in there.rounds.items()}
            others = {of: run for of, run in runs.items() if (run.planner, run.method) != (mine.planner, mine.method)}
            text = msgspec.json.encode(_File(runs={**others, self.key: mine}), order="deterministic")
            write_atomic(self.suite / EXPLORED, msgspec.json.format(text, indent=1) + b"\n")


def open_explored(suite: Path, key: str, planner: str, method: str) -> ExploredFile:
    """Open a suite's file for the run `key`; other versions of the planner are dropped. Raises CaseError."""
    return ExploredFile(suite, key, _read_explored(suite).runs.get(key) or ExploredWindows(planner, method))


def _read_explored(suite: Path) -> _File:
    path = require_inside(suite / EXPLORED, suite)
    try:
        content = from_json(read_bounded(path, JSON_BYTES), _File) if path.exists() else _File()
    except msgspec.MsgspecError as error:
        raise CaseError(f"{path}: {error} (remove it to explore from the beginning)") from error
    if content.schema > SCHEMA:
        raise CaseError(f"{path}: schema {content.schema}, this version reads up to {SCHEMA} (upgrade regents_cosim)")
    return content


def _surroundings(tags: tuple[str, ...]) -> str:
    """The surroundings of the ego in words, from tags: what the ego does, place, lights and density."""
    return ", ".join(tag for tag in _AROUND if tag in tags)


_MOST_MINUTES = 10_000
_OLD_ROUNDS = 2  # this many rounds in a row without a new window: the traffic holds no more

# gives the windows of a round, counted from 0; empty when the traffic is used up
Record = Callable[[int], Sequence[Scenario]]


@dataclass(frozen=True)
class AddedCrash:
    """A crash that was added to the suite."""

    crash: Crash
    cell: Cell
    why: str  # "new cell", "plainer" or "gentler"
    than: str  # name of the former best case of its cell; empty for a new cell


@dataclass(frozen=True)
class SuiteIntake:
    """A suite with the requirements for crashes that it takes in."""

    folder: Path
    archive: Archive  # of the crashes in the suite
    still: Still | None  # draws the picture of a case; None: cases have no pictures
    verify: bool = True  # whether SUMO has to confirm a crash
    # saves an added case in a second place, and returns its folder there
    copy: Callable[[Scenario], Path] | None = None

    def take(self, crashes: Sequence[Scenario]) -> list[AddedCrash]:
        """Add those of the crashes that are new, and return them."""
        new = [case for case in crashes if (crash := crash_of(case)) and self.archive.improves(crash)]
        if self.verify and new:
            new = list(verified_only(new))
        return [added for case in new if (added := self._add(case))]

    def _add(self, case: Scenario) -> AddedCrash | None:
        """Add a crash, unless an earlier one of the same list has just filled its cell with a better one."""
        crash = crash_of(case)
        why = self.archive.improves(crash) if crash else ""
        if crash is None or not why:
            return None
        best = self.archive.elite(cell_of(crash))
        with uninterrupted():
            folder = add_case(case, self.folder, replace(load_manifest(self.folder), cases=()), beside=True)
            case, crash = replace(case, id=folder.name), replace(crash, case=folder.name)
            added = AddedCrash(crash, self.archive.add(crash), why, best.case if best else "")
        announce_kept(f"new cases are added to {self.folder}; for the windows that are left run the same command again")
        places = [folder, *([self.copy(case)] if self.copy else [])]
        if self.still is not None:
            for place in places:
                write_atomic(place / STILL, self.still(case))
        return added


@dataclass(repr=False)
class Growth(ShortRepr, Tabular):
    """The results of one run; its table has the added crashes."""

    added: list[AddedCrash] = field(default_factory=list)
    windows: int = 0
    crashes: int = 0  # found crashes, including known ones
    used_up: bool = False  # it ended early because there are no more windows
    errors: list[str] = field(default_factory=list)  # failures of the planner

    def to_dict(self) -> list[dict[str, Any]]:
        """A row for each added crash."""
        return [
            {
                "case": one.crash.case,
                "why": one.why,
                **dict(zip(NAMES, one.cell, strict=True)),
                "standing": one.crash.standing,
                "quality": round(one.crash.quality, 3),
                "than": one.than or None,
            }
            for one in self.added
        ]


@dataclass(frozen=True)
class Budget:
    """The end of a run: a time after which no window begins, though those in work are finished; or one round."""

    ends_s: float | None  # by time.monotonic(); None: after the first round that has windows to attack

    @classmethod
    def of(cls, minutes: float | None) -> "Budget":
        """An end `minutes` from now; without them after one round. Raises RegentsError."""
        if minutes is None:
            return cls(None)
        if not 0.0 < minutes <= _MOST_MINUTES:
            raise RegentsError(f"--minutes {minutes:g}: expected more than 0 and at most {_MOST_MINUTES}")
        return cls(time.monotonic() + 60.0 * minutes)

    @property
    def is_spent(self) -> bool:
        """Whether the time is over."""
        return self.ends_s is not None and time.monotonic() >= self.ends_s


@dataclass(frozen=True)
class GrowingSuite:
    """A suite with the settings by which it grows."""

    intake: SuiteIntake
    explored: ExploredFile
    run: AttackRun
    progress: Progress = SILENT

    def grow(self, traffic: str, record: Record, budget: Budget) -> Growth:
        """Attack windows of `traffic` until budget or windows run out; `record` gives the windows of a round."""
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
            if growth.windows and budget.ends_s is None:
                break
        return growth

    def _attack(self, left: dict[str, Scenario], budget: Budget, growth: Growth) -> None:
        """Attack windows, the least explored first, and remove finished ones from `left`."""
        # so that each window is chosen only when its turn comes
        run = replace(self.run, batch=min(self.run.batch, cores()))
        begun: deque[tuple[str, str]] = deque()
        attacked = run.attack(self._chosen(dict(left), budget, begun))
        for cases in self.progress.each(attacked, "attacking", len(left), window_row):
            digest, kind = begun.popleft()
            self._take(cases, growth)
            self.explored.note(digest, kind)
            del left[digest]

    def _chosen(self, left: dict[str, Scenario], budget: Budget, begun: deque[tuple[str, str]]) -> Iterator[Scenario]:
        """Choose windows one by one, always of the surroundings with the fewest attacked windows and filled cells."""
        kinds = {digest: _surroundings(tags_of(window)) for digest, window in left.items()}
        tried = Counter(self.explored.run.windows.values())
        while left and not budget.is_spent:
            filled = Counter(_surroundings(crash.tags) for crash in self.intake.archive.elites.values())
            digest = min(left, key=lambda one: (tried[kinds[one]] + filled[kinds[one]], one))
            tried[kinds[digest]] += 1
            begun.append((digest, kinds[digest]))
            yield left.pop(digest)

    def _take(self, cases: Sequence[Scenario], growth: Growth) -> None:
        growth.windows += 1
        growth.errors += [case.attack.planner_error for case in cases if case.attack and case.attack.planner_error]
        crashes = crashes_of(cases)
        growth.crashes += len(crashes)
        growth.added += self.intake.take(crashes)
