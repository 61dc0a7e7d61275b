"""Methods run on windows for the tables: attacked, judged, verified in SUMO, timed."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

from regents_cosim.attacks.attack import attack_each
from regents_cosim.attacks.methods.presets import OURS, AttackConfig, preset
from regents_cosim.benchmarks.aggressive import METHOD as AGGRESSIVE
from regents_cosim.benchmarks.aggressive import drive_aggressively
from regents_cosim.benchmarks.kept_runs import joined, run_once
from regents_cosim.benchmarks.table1 import Table1, table1
from regents_cosim.benchmarks.table_files import require_table, write_table
from regents_cosim.evaluation.crashes.scores import CrashInSumo, MethodRun, Protocol, Results, rollouts_at_most
from regents_cosim.planners.under_test import AnyPlanner, PlannerUnderTest
from regents_cosim.replays.replay import verify_in_sumo
from regents_cosim.scenario import Scenario
from regents_cosim.system.progress import SILENT, Progress
from regents_cosim.verdicts.judge import judge_each

_OF_PAPERS = ("king", "regents")
_PRESETS = (*_OF_PAPERS, "focused")
_ALL = (*_PRESETS, "random", "cma-es", "starts")


@dataclass(frozen=True)
class ComparedMethod:
    """What a column of the table is about."""

    name: str
    config: AttackConfig | None  # None: SUMO's own drivers, who search nothing


def columns(methods: Sequence[str], equal_protocol: bool, given: Mapping[str, Any]) -> list[ComparedMethod]:
    """The columns of a table, for one planner; `given` takes the place of the presets' settings.

    With an equal protocol all search by the rules of ours, and those of the papers as there besides.
    """
    chosen = methods or (_ALL if equal_protocol else _PRESETS)
    if equal_protocol:
        return [*_as_in_papers(chosen, given), *_by_our_protocol(chosen, given)]
    return [ComparedMethod(method, _config(method, given)) for method in chosen]


def _as_in_papers(methods: Sequence[str], given: Mapping[str, Any]) -> list[ComparedMethod]:
    return [ComparedMethod(method, _config(method, given)) for method in methods if method in _OF_PAPERS]


def _by_our_protocol(methods: Sequence[str], given: Mapping[str, Any]) -> list[ComparedMethod]:
    ours = _config(OURS.method, given)
    assert ours is not None
    found = []
    for method in methods:
        config = _config(method, given)
        name = method if config is None or method == ours.method else f"{config.method}, protocol of {ours.method}"
        found.append(ComparedMethod(name, config and config.by_protocol_of(ours)))
    return found


def _config(method: str, given: Mapping[str, Any]) -> AttackConfig | None:
    return None if method == AGGRESSIVE else preset(method, **given)


def tables(
    places: Sequence[list[Scenario]],
    planners: Sequence[AnyPlanner],
    wanted: Sequence[ComparedMethod],
    *,
    tuned_on: Sequence[str] = (),
    output: Path | None = None,
    progress: Progress = SILENT,
) -> Iterator[Table1]:
    """The table as it grows, planner by planner and place by place; the last one is the whole.

    `output` keeps the runs, and the table after every place: one that is interrupted goes on from there.
    """
    if output is not None:
        require_table(output)
    runs = list[MethodRun]()
    for planner in map(PlannerUnderTest.of, planners):
        before = runs
        for here in places_run(places, planner, wanted, output, progress):
            runs = [*before, *here]
            yield _written(table1(runs, tuned_on), output)


def _written(table: Table1, output: Path | None) -> Table1:
    if output is not None:
        write_table(table, output)
    return table


def places_run(
    places: Sequence[list[Scenario]],
    planner: PlannerUnderTest,
    wanted: Sequence[ComparedMethod],
    output: Path | None,
    progress: Progress,
) -> Iterator[list[MethodRun]]:
    """The runs of all columns, place by place: after each, those on the places so far."""
    done: list[list[MethodRun]] = [[] for _ in wanted]
    for windows in places:
        here: list[MethodRun] = []
        for column, runs in zip(wanted, done, strict=True):
            here.append(one_run(windows, planner, column, here, output, progress))
            runs.append(here[-1])
        yield [joined(runs) for runs in done]


def one_run(
    windows: list[Scenario],
    planner: PlannerUnderTest,
    column: ComparedMethod,
    others: list[MethodRun],
    output: Path | None,
    progress: Progress,
) -> MethodRun:
    """A method on the windows of one place: the run that `output` keeps of it, else a new one."""

    def make() -> MethodRun:
        if column.config is None:
            return aggressive_run(windows, planner, others, progress)
        return attack_run(windows, planner, column, progress)

    settings = {"config": column.config.settings if column.config else None}
    return run_once(output, column.name, planner.name, settings, windows, make)


def attack_run(
    windows: list[Scenario], planner: PlannerUnderTest, column: ComparedMethod, progress: Progress
) -> MethodRun:
    """An attack on all `windows`."""
    config = column.config
    assert config is not None
    begin = perf_counter()
    attacks = attack_each(windows, config, planner)
    found: list[Results] = list(progress.each(attacks, f"{column.name} against {planner.name}", len(windows)))
    seconds = perf_counter() - begin
    return judged_run(column.name, planner.name, rollouts_at_most(config), found, seconds, progress, config.protocol)


def aggressive_run(
    windows: list[Scenario], planner: PlannerUnderTest, others: list[MethodRun], progress: Progress
) -> MethodRun:
    """SUMO's own drivers at their most dangerous, on the same windows as the `others`."""
    nothing: list[Results] = [[] for _ in windows]
    before = next((run.windows for run in others if run.planner == planner.name), nothing)
    begin = perf_counter()
    driven = drive_aggressively(windows, before, planner)
    found = list(progress.each(driven, f"{AGGRESSIVE} against {planner.name}", len(windows)))
    return judged_run(AGGRESSIVE, planner.name, 1, found, perf_counter() - begin, progress)


def judged_run(
    method: str,
    planner: str,
    rollouts: int,
    found: list[Results],
    seconds: float,
    progress: Progress,
    protocol: Protocol = (),
) -> MethodRun:
    """What was found, judged and verified in SUMO."""
    cases = [case for results in found for case in results]
    judged = iter(list(progress.each(judge_each(cases), "judging", len(cases))))
    windows = [[next(judged) for _ in results] for results in found]
    replays = verify_in_sumo([case for results in windows for case in results], progress=progress)
    in_sumo = [CrashInSumo(one.case, one.verified, one.reports_same_pair) for one in replays.values()]
    return MethodRun(method, planner, rollouts, windows, in_sumo, seconds, protocol)
