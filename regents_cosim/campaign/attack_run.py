"""An attack that may be stopped at any moment: window by window into a folder, and nothing twice.

A window is done when its cases are saved, judged, verified in SUMO and drawn; then the ledger notes it. Windows are
finished in their order, whichever is searched first.
"""

from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from regents_cosim.attacks.attack import Engine, attack_each, engine_of, searched_together
from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.campaign.identity import Identity, identity
from regents_cosim.campaign.ledger import DoneUnit, Ledger, LedgerRecord, WorkUnit
from regents_cosim.campaign.planner_files import planner_digest
from regents_cosim.campaign.requests import Wanted
from regents_cosim.campaign.windows import RunWindows
from regents_cosim.cases.files import load_header
from regents_cosim.cases.header import Header
from regents_cosim.cases.manifest import drop_cases
from regents_cosim.cases.suite import SuiteWriter
from regents_cosim.planners.patience import ACT_TIMEOUT_S
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.replays.replay import replay_each
from regents_cosim.replays.verify import Replay
from regents_cosim.scenario import Scenario
from regents_cosim.verdicts.judge import judge_each


@dataclass(frozen=True)
class AttackRun:
    """How every window is attacked, and what is done with what is found."""

    config: AttackConfig
    planner: str
    against: tuple[str, ...] = ()
    batch: int = 32
    engine: Engine = "auto"
    act_timeout_s: float = ACT_TIMEOUT_S
    judge: bool = True
    verify: bool = True
    pictures: bool = True
    wanted: Wanted | None = None  # crashes of these kinds alone are kept, until there are enough

    def together(self) -> int:
        """Windows that are searched in one computation. Raises PlannerError."""
        under_test = PlannerUnderTest.of(self.planner)
        return searched_together(under_test, self.config, self.engine, self.batch, self.act_timeout_s)

    def identity(self, traffic: dict[str, Any], together: int) -> Identity:
        """What decides the results; `traffic` by the names of its options."""
        names = (self.planner, *self.against)
        mine = {"planner": self.planner, "against": list(self.against), "act_timeout": self.act_timeout_s}
        mine |= {"judge": self.judge, "verify": self.verify, "pictures": self.pictures}
        mine |= {"engine": engine_of(self.engine)} | ({"batch": self.batch} if together > 1 else {})
        mine |= {"type": dict(self.wanted.counts)} if self.wanted else {}
        settings = {**traffic, **asdict(self.config), **mine}
        return identity("attack", settings, {name: planner_digest(name) for name in names})

    def attack(self, scenarios: Iterable[Scenario]) -> Iterator[list[Scenario]]:
        """The cases of each scenario, judged."""
        runs = attack_each(
            scenarios,
            self.config,
            self.planner,
            self.batch,
            engine=self.engine,
            act_timeout_s=self.act_timeout_s,
            against=self.against,
        )
        return (list(judge_each(results)) if self.judge else results for results in runs)


@dataclass
class _Attacked:
    """A window whose cases are saved."""

    unit: WorkUnit
    cases: list[Scenario]
    open: set[str] = field(default_factory=set)  # cases that SUMO has not answered for
    replays: dict[str, Replay] = field(default_factory=dict)


Watch = Callable[[Iterator[list[Scenario]], int], Iterator[list[Scenario]]]  # passes on what is done, of so many


def attack_left(
    ledger: Ledger,
    windows: RunWindows,
    run: AttackRun,
    suite: SuiteWriter,
    *,
    draw: Callable[[Scenario], None],
    retry: bool = False,
    executor: Executor | None = None,
    watch: Watch = lambda done, of: done,
) -> None:
    """Attack the windows that are not done, and those that failed with `retry`; what was done of them is replaced."""
    left = {unit.name for unit in ledger.left(retry)}
    searched = _with_neighbours(ledger.record.own, left, ledger.record.begun.together)
    results = watch(run.attack(windows.load(unit.name for unit in searched)), len(searched))
    found = ((unit, cases) for unit, cases in zip(searched, results, strict=True) if unit.name in left)
    kept = found if run.wanted is None else _wanted(found, run.wanted, run.wanted.found_in(ledger.record, suite.folder))
    saved = (_saved(unit, cases, suite) for unit, cases in kept)
    _each_in_order(saved, executor if run.verify else None, run.verify, lambda one: _finish(one, ledger, run, draw))


Found = Iterator[tuple[WorkUnit, list[Scenario]]]


def _wanted(found: Found, wanted: Wanted, so_far: Counter[str]) -> Found:
    """Of every window the crashes that are asked for, until there are enough, and where the planner failed."""
    while not wanted.is_met(so_far):
        one = next(found, None)
        if one is None:
            return
        unit, cases = one
        yield unit, [case for case in cases if wanted.takes(case, so_far) or _has_failed(case)]


def _has_failed(case: Scenario) -> bool:
    return case.attack is not None and bool(case.attack.planner_error)


def attacked_headers(record: LedgerRecord, folder: Path) -> tuple[list[Header], dict[str, Replay]]:
    """What a run has left in a folder, without the tracks, in the order of its windows; and what SUMO said of it."""
    done = [record.done[unit.name] for unit in record.own if record.is_done(unit)]
    replays = {name: Replay(name, **said) for one in done for name, said in one.said.get("replays", {}).items()}
    return [load_header(folder / name) for one in done for name, _ in one.cases], replays


def _with_neighbours(own: Sequence[WorkUnit], left: set[str], together: int) -> list[WorkUnit]:
    """The units that are left, and those that share a computation with one of them."""
    groups = [own[at : at + together] for at in range(0, len(own), together)]
    return [unit for group in groups if left & {unit.name for unit in group} for unit in group]


def _saved(unit: WorkUnit, cases: list[Scenario], suite: SuiteWriter) -> _Attacked:
    for case in cases:
        suite.add(case)
    return _Attacked(unit, cases)


def _each_in_order(
    attacked: Iterator[_Attacked], executor: Executor | None, verify: bool, finish: Callable[[_Attacked], None]
) -> None:
    """Verify the crashes of windows as they come; finish every window, in order, as soon as it can be."""
    waiting: deque[_Attacked] = deque()
    home: dict[str, _Attacked] = {}

    def finish_first() -> None:
        while waiting and not waiting[0].open:
            finish(waiting.popleft())

    def crashes() -> Iterator[Scenario]:
        for one in attacked:
            hits = [case for case in one.cases if verify and case.attack and case.attack.outcome == "collision"]
            one.open |= {case.id for case in hits}
            home.update(dict.fromkeys(one.open, one))
            waiting.append(one)
            finish_first()
            yield from hits

    for replay in replay_each(crashes(), "sumo", executor=executor):
        one = home.pop(replay.case)
        one.open.discard(replay.case)
        one.replays[replay.case] = replay
        finish_first()


def _finish(one: _Attacked, ledger: Ledger, run: AttackRun, draw: Callable[[Scenario], None]) -> None:
    """Draw a window's cases, remove what an earlier attack left of it, and note it."""
    if run.pictures:
        for case in one.cases:
            draw(case)
    names = [case.id for case in one.cases]
    before = ledger.record.done.get(one.unit.name)
    if before and (stale := {name for name, _ in before.cases} - set(names)):
        drop_cases(stale, ledger.folder)
    hashes = [(name, load_header(ledger.folder / name).hash) for name in names]
    replays = {name: _said(replay) for name, replay in sorted(one.replays.items())}
    ledger.note(DoneUnit(one.unit, tuple(hashes), {"replays": replays} if replays else {}, _error(one)))


def _said(replay: Replay) -> dict[str, Any]:
    return {"verified": replay.verified, "reason": replay.reason, "planner_failed": replay.planner_failed}


def _error(one: _Attacked) -> str:
    """Why a window failed, in one line: its planner did, or SUMO could not replay what was found."""
    planner = [case.attack.planner_error for case in one.cases if case.attack and _has_failed(case)]
    sumo = [replay.reason for replay in one.replays.values() if replay.replayed is None]
    return next(iter([*planner, *sumo]), "").partition("\n")[0]
