"""Runs of a table kept on disk as soon as they are made: a table that was interrupted goes on, or grows by places.

Each run has a folder of its own, with a ledger of one unit of work: the run. The folder's name says what was run: the
method with its settings, the planner with its files, the windows and the versions of the packages, ours included, so
that a run of something else is never taken for it. A run is made as a whole, for its time is measured.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case, load_header
from regents_cosim.checks.names import file_name, inside, word
from regents_cosim.evaluation.crashes.scores import CrashInSumo, MethodRun
from regents_cosim.runs.identity import Identity, identity
from regents_cosim.runs.ledger import RUNS, DoneUnit, WorkUnit, forget_lost, open_ledger
from regents_cosim.runs.planner_files import planner_digest
from regents_cosim.saving import SuiteWriter
from regents_cosim.scenario import Scenario

_NAME = 60  # letters of a method and a planner in a folder's name


class _Said(msgspec.Struct, frozen=True):
    """What the cases do not say."""

    method: str
    planner: str
    rollouts: int
    seconds: float
    protocol: list[tuple[str, str | int | float]]  # in its order
    windows: list[list[str]]  # ids of the results of each
    in_sumo: list[CrashInSumo]


def run_once(
    output: Path | None,
    method: str,
    planner: str,
    settings: Mapping[str, Any],
    windows: Sequence[Scenario],
    make: Callable[[], MethodRun],
) -> MethodRun:
    """A method on these windows: the run that `output` keeps of it, else the one that is made now, which it then keeps.

    Raises RegentsError where the folder cannot be written or another process is at work on that run, CaseError where
    what it keeps is damaged.
    """
    if output is None:
        return make()
    mine = identity("bench", {"method": method, "planner": planner, **settings}, {planner: planner_digest(planner)})
    unit = WorkUnit("run", mine.key(*map(content_hash, windows)))
    folder = inside(output, RUNS, file_name(word(method, _NAME), word(planner, _NAME), unit.key))
    return _once(folder, mine, unit, make)


def _once(folder: Path, mine: Identity, unit: WorkUnit, make: Callable[[], MethodRun]) -> MethodRun:
    suite = SuiteWriter(folder, 0)
    with open_ledger(folder, mine) as ledger:
        forget_lost(ledger)
        if not ledger.record.is_done(unit):
            run = make()
            ledger.plan("", [unit])
            saved = [(case.id, load_header(suite.add(case)).hash) for results in run.windows for case in results]
            ledger.note(DoneUnit(unit, tuple(saved), msgspec.to_builtins(_said(run))))
        ledger.finish()
        return _kept(folder, msgspec.convert(ledger.record.done[unit.name].said, _Said))


def _said(run: MethodRun) -> _Said:
    return _Said(
        run.method,
        run.planner,
        run.rollouts,
        run.seconds,
        [(name, value if isinstance(value, int | float) else str(value)) for name, value in run.protocol],
        [[case.id for case in results] for results in run.windows],
        list(run.in_sumo),
    )


def _kept(folder: Path, said: _Said) -> MethodRun:
    windows = [[load_case(folder / name) for name in names] for names in said.windows]
    return MethodRun(
        said.method, said.planner, said.rollouts, windows, said.in_sumo, said.seconds, tuple(said.protocol)
    )


def joined(runs: Sequence[MethodRun]) -> MethodRun:
    """The runs of one method on several places as one."""
    first = runs[0]
    return MethodRun(
        first.method,
        first.planner,
        first.rollouts,
        [results for run in runs for results in run.windows],
        [one for run in runs for one in run.in_sumo],
        sum(run.seconds for run in runs),
        first.protocol,
    )
