"""An attack that may be stopped at any moment: it works window by window into a folder, and does nothing twice.

A window is done when its cases are saved, judged, verified in SUMO and drawn; then the ledger notes it. Windows are
finished in order, whichever is searched first. Workers of a cluster do all of this except writing, as they share no
disk with the folder.
"""

from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from regents_cosim.attacks.attack import window_row
from regents_cosim.cases.files import STILL, load_header, note_holds
from regents_cosim.cases.header import Header
from regents_cosim.cases.manifest import drop_cases
from regents_cosim.checks.names import inside
from regents_cosim.errors import RegentsError
from regents_cosim.replays.holds import verified_each
from regents_cosim.replays.verify import Replay
from regents_cosim.runs.ledger import DoneUnit, Ledger, LedgerRecord, WorkUnit
from regents_cosim.runs.requests import WantedManoeuvres
from regents_cosim.runs.window_job import AttackedWindow, AttackRun, Still, attack_window, crashes_of, has_failed
from regents_cosim.runs.windows import RunWindows
from regents_cosim.saving import SuiteWriter
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.system.files.atomic import write_atomic
from regents_cosim.system.progress import SILENT, Progress
from regents_cosim.system.workers import run_each


@dataclass
class _Saved:
    """A window whose cases are saved, but not all verified."""

    unit: WorkUnit
    found: AttackedWindow
    open: set[str] = field(default_factory=set)  # names of cases that SUMO has not replayed yet


def attack_left(
    ledger: Ledger,
    windows: RunWindows,
    run: AttackRun,
    suite: SuiteWriter,
    *,
    still: Still | None = None,
    retry: bool = False,
    cluster: Executor | None = None,
    sumo: Executor | None = None,
    progress: Progress = SILENT,
) -> None:
    """Attack the windows that are not done, and with `retry` those that failed; new results replace old ones.

    `still` draws the picture of a case; without it cases have none. Workers of `cluster` attack one window at a time;
    without a cluster this machine does, and verifies crashes in the processes of `sumo`, or in processes of its own.
    """
    output = _Output(ledger, suite, still)
    left = {unit.name for unit in ledger.left(retry)}
    searched = _with_neighbours(ledger.record.own, left, ledger.record.begun.together)
    scenarios = (windows.fetch(unit.name) for unit in searched)
    attacked = map(AttackedWindow, run.attack(scenarios)) if cluster is None else _there(run, scenarios, still, cluster)
    results = progress.each(attacked, "attacking", len(searched), lambda window: window_row(window.cases))
    found = ((unit, window) for unit, window in zip(searched, results, strict=True) if unit.name in left)
    so_far = run.wanted.found_in(ledger.record, ledger.folder) if run.wanted else Counter[str]()
    kept = found if run.wanted is None else _wanted(found, run.wanted, so_far)
    saved = (output.save(unit, window) for unit, window in kept)
    _each_in_order(saved, run.verify and cluster is None, sumo, output.finish)


@dataclass(frozen=True)
class _Output:
    ledger: Ledger
    suite: SuiteWriter
    still: Still | None

    def save(self, unit: WorkUnit, window: AttackedWindow) -> _Saved:
        """Save the cases of a window."""
        self.ledger.note_begun(unit.name, [case.id for case in window.cases])
        for case in window.cases:
            self.suite.add(case)
        return _Saved(unit, window)

    def finish(self, one: _Saved) -> None:
        """Draw the cases of a window, remove the remains of an earlier attack on it, and note it in the ledger."""
        found, before = one.found, self.ledger.record.done.get(one.unit.name)
        for case in found.cases:
            self._complete(case, found)
        names = [case.id for case in found.cases]
        if before and (stale := {name for name, _ in before.cases} - set(names)):
            drop_cases(stale, self.ledger.folder)
        hashes = tuple((name, load_header(self.ledger.folder / name).hash) for name in names)
        replays = {case.id: _said(found.verified[case.id][0]) for case in found.cases if case.id in found.verified}
        said: dict[str, Any] = {"replays": dict(sorted(replays.items()))} if replays else {}
        said |= {} if found.promised is None else {"promised": sorted(found.promised)}
        self.ledger.note(DoneUnit(one.unit, hashes, said, _error(found)))

    def _complete(self, case: Scenario, found: AttackedWindow) -> None:
        """Note whether a saved crash holds, and draw the case."""
        folder = inside(self.ledger.folder, case.id)
        if case.judgement and case.id in found.verified:
            note_holds(folder, found.verified[case.id][1])
        if self.still is not None:
            write_atomic(folder / STILL, found.stills.get(case.id) or self.still(case))


def _there(
    run: AttackRun, scenarios: Iterator[Scenario], still: Still | None, cluster: Executor
) -> Iterator[AttackedWindow]:
    """The results of the workers, in order. Raises RegentsError for a window whose worker dies repeatedly."""
    for answer in run_each(partial(attack_window, run, still), scenarios, cluster):
        if isinstance(answer, RegentsError):
            raise answer
        yield answer


Found = Iterator[tuple[WorkUnit, AttackedWindow]]


def _wanted(found: Found, wanted: WantedManoeuvres, so_far: Counter[str]) -> Found:
    """For every window the crashes that are asked for, until there are enough, and the planner's failures."""
    while not wanted.is_met(so_far):
        one = next(found, None)
        if one is None:
            return
        unit, window = one
        kept = [case for case in window.cases if wanted.takes(case, so_far) or has_failed(case)]
        yield unit, replace(window, cases=kept, promised=wanted.promised_by(window.cases))


def attacked_headers(record: LedgerRecord, folder: Path) -> tuple[list[Header], dict[str, Replay]]:
    """The headers of the cases that a run left in a folder, in the order of its windows, and their replays in SUMO."""
    done = record.finished
    replays = {name: Replay(name, **said) for one in done for name, said in one.said.get("replays", {}).items()}
    return [load_header(folder / name) for one in done for name, _ in one.cases], replays


def _with_neighbours(own: Sequence[WorkUnit], left: set[str], together: int) -> list[WorkUnit]:
    """The units that are left, and those that share a computation with one of them."""
    groups = [own[at : at + together] for at in range(0, len(own), together)]
    return [unit for group in groups if left & {unit.name for unit in group} for unit in group]


def _each_in_order(
    saved: Iterator[_Saved], verify: bool, sumo: Executor | None, finish: Callable[[_Saved], None]
) -> None:
    """Verify crashes as they come, and finish every window, in order, as soon as its crashes are verified."""
    waiting: deque[_Saved] = deque()
    home: dict[str, _Saved] = {}

    def finish_first() -> None:
        while waiting and not waiting[0].open:
            finish(waiting.popleft())

    def crashes() -> Iterator[Scenario]:
        for one in saved:
            hits = crashes_of(one.found.cases) if verify else []
            one.open |= {case.id for case in hits}
            home.update(dict.fromkeys(one.open, one))
            waiting.append(one)
            finish_first()
            yield from hits

    for verified in verified_each(crashes(), sumo):
        case = verified[0].case
        one = home.pop(case)
        one.open.discard(case)
        one.found.verified[case] = verified
        finish_first()


def _said(replay: Replay) -> dict[str, Any]:
    return {"verified": replay.verified, "reason": replay.reason, "planner_failed": replay.planner_failed}


def _error(found: AttackedWindow) -> str:
    """The reason in one line why a window failed: the planner failed, or SUMO could not replay a case."""
    planner = [case.attack.planner_error for case in found.cases if case.attack and has_failed(case)]
    sumo = [replay.reason for replay, _ in found.verified.values() if replay.replayed is None]
    return next(iter([*planner, *sumo]), "").partition("\n")[0]
