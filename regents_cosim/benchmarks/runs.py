"""Methods run on windows for the tables: attacked, judged, verified in SUMO, timed."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any, TypedDict, Unpack

import msgspec

from regents_cosim.attacks.attack import attack_each
from regents_cosim.attacks.methods.presets import METHODS, OURS, AttackConfig, preset
from regents_cosim.benchmarks.table1 import Table1, table1
from regents_cosim.benchmarks.table1_sections import markdown
from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case
from regents_cosim.cases.shipped import NETWORKS, network
from regents_cosim.checks.names import file_name, inside, word
from regents_cosim.checks.typed_values import from_values
from regents_cosim.evaluation.crashes.scores import CrashInSumo, MethodRun, Results, rollouts_at_most
from regents_cosim.planners.under_test import AnyPlanner, PlannerUnderTest
from regents_cosim.replays.replay import verify_in_sumo
from regents_cosim.runs.identity import identity
from regents_cosim.runs.ledger import RUNS, WorkUnit
from regents_cosim.runs.planner_files import digest_of
from regents_cosim.runs.windows import make_once
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.sources.record import LogInput, record
from regents_cosim.sources.windows import Prefer
from regents_cosim.system.files.output_files import MARK, require_output, write_output_file
from regents_cosim.system.progress import SILENT, Progress
from regents_cosim.verdicts.judge import judge_each

_OF_PAPERS = ("king", "regents")
_PRESETS = (*_OF_PAPERS, "focused")
_ALL = (*_PRESETS, *(name for name in METHODS if name not in _PRESETS))


class WindowChoice(TypedDict, total=False):
    """Which windows of each place are taken, as in `record`."""

    count: int
    prefer: Prefer
    horizon_s: float


@dataclass(frozen=True)
class ComparedMethod:
    """What a column of the table is about."""

    name: str
    config: AttackConfig


def columns(methods: Sequence[str], equal_protocol: bool, given: Mapping[str, Any]) -> list[ComparedMethod]:
    """The columns of a table, for one planner; `given` takes the place of the presets' settings.

    With an equal protocol all search by the rules of ours, and those of the papers as there besides.
    """
    chosen = methods or (_ALL if equal_protocol else _PRESETS)
    as_they_are = [one for one in chosen if one in _OF_PAPERS] if equal_protocol else chosen
    found = [ComparedMethod(method, preset(method, **given)) for method in as_they_are]
    return [*found, *_by_our_protocol(chosen, given)] if equal_protocol else found


def _by_our_protocol(methods: Sequence[str], given: Mapping[str, Any]) -> list[ComparedMethod]:
    ours = preset(OURS.method, **given)
    found = []
    for method in methods:
        config = preset(method, **given)
        name = method if method == ours.method else f"{config.method}, protocol of {ours.method}"
        found.append(ComparedMethod(name, config.by_protocol_of(ours)))
    return found


def tables(
    places: Sequence[list[Scenario]],
    planners: Sequence[AnyPlanner],
    wanted: Sequence[ComparedMethod],
    *,
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
            table = table1(runs)
            if output is not None:
                write_table(table, output)
            yield table


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
        for column, runs in zip(wanted, done, strict=True):
            runs.append(one_run(windows, planner, column, output, progress))
        yield [joined(runs) for runs in done]


def one_run(
    windows: list[Scenario], planner: PlannerUnderTest, column: ComparedMethod, output: Path | None, progress: Progress
) -> MethodRun:
    """A method on the windows of one place: the run that `output` keeps of it, else a new one."""
    make = partial(attack_run, windows, planner, column, progress)
    return make() if output is None else run_once(output, column, planner, windows, make)


def attack_run(
    windows: list[Scenario], planner: PlannerUnderTest, column: ComparedMethod, progress: Progress
) -> MethodRun:
    """An attack on all `windows`, judged and verified in SUMO."""
    begin = perf_counter()
    attacks = attack_each(windows, column.config, planner)
    found: list[Results] = list(progress.each(attacks, f"{column.name} against {planner.name}", len(windows)))
    seconds = perf_counter() - begin
    cases = [case for results in found for case in results]
    judged = iter(list(progress.each(judge_each(cases), "judging", len(cases))))
    results = [[next(judged) for _ in its] for its in found]
    replays = verify_in_sumo([case for its in results for case in its], progress=progress)
    in_sumo = [CrashInSumo(one.case, one.verified, one.reports_same_pair) for one in replays.values()]
    return _of_column(column, planner.name, results, in_sumo, seconds)


_FILES = ("table1.md", "table1.json")


def require_table(folder: Path) -> None:
    """Raise RegentsError where a file of the table cannot be written, or something that is not ours has its name."""
    for name in _FILES:
        require_output(folder / name)


def write_table(table: Table1, folder: Path) -> None:
    """The table as Markdown and JSON."""
    require_table(folder)
    write_output_file(folder / "table1.md", f"<!-- {MARK} -->\n{markdown(table)}".encode())
    write_output_file(folder / "table1.json", json.dumps({"generator": MARK, **table.to_dict()}, indent=1).encode())


# Runs of a table kept on disk as soon as they are made: a table that was interrupted goes on, or grows by places.
# Each run has a folder of its own, with a ledger of one unit of work: the run. The folder's name says what was run:
# the method with its settings, the planner with its files, the windows and the versions of the packages, ours
# included, so that a run of something else is never taken for it. A run is made as a whole, for its time is measured.
_NAME = 60  # letters of a method and a planner in a folder's name


class _Said(msgspec.Struct, frozen=True):
    """What the cases do not say."""

    seconds: float
    windows: list[list[str]]  # ids of the results of each
    in_sumo: list[CrashInSumo]


def run_once(
    output: Path,
    column: ComparedMethod,
    planner: PlannerUnderTest,
    windows: Sequence[Scenario],
    make: Callable[[], MethodRun],
) -> MethodRun:
    """A method on these windows: the run that `output` keeps of it, else the one that is made now, which it then keeps.

    Raises RegentsError where the folder cannot be written or another process is at work on that run, CaseError where
    what it keeps is damaged.
    """
    settings = {"method": column.name, "planner": planner.name, "config": column.config.settings}
    mine = identity("bench", settings, {planner.name: digest_of(planner)})
    unit = WorkUnit("run", mine.key(*map(content_hash, windows)))
    folder = inside(output, RUNS, file_name(word(column.name, _NAME), word(planner.name, _NAME), unit.key))

    def made() -> tuple[list[Scenario], dict[str, Any]]:
        run = make()
        ids = [[case.id for case in results] for results in run.windows]
        cases = [case for results in run.windows for case in results]
        return cases, msgspec.to_builtins(_Said(run.seconds, ids, list(run.in_sumo)))

    said = from_values(make_once(folder, mine, unit, 0, made).said, _Said)
    kept = [[load_case(folder / name) for name in names] for names in said.windows]
    return _of_column(column, planner.name, kept, said.in_sumo, said.seconds)


def _of_column(
    column: ComparedMethod, planner: str, windows: Sequence[Results], in_sumo: Sequence[CrashInSumo], seconds: float
) -> MethodRun:
    config = column.config
    return MethodRun(column.name, planner, rollouts_at_most(config), windows, in_sumo, seconds, config.protocol)


def joined(runs: Sequence[MethodRun]) -> MethodRun:
    """The runs of one method on several places as one."""
    return replace(
        runs[0],
        windows=[results for run in runs for results in run.windows],
        in_sumo=[one for run in runs for one in run.in_sumo],
        seconds=sum(run.seconds for run in runs),
    )


def traffic_of(
    nets: Sequence[str],
    logs: Sequence[Path],
    seeds: Sequence[int],
    progress: Progress = SILENT,
    **how: Unpack[WindowChoice],
) -> list[list[Scenario]]:
    """Windows of networks and of logs, place by place: of the six shipped networks where neither is named.

    A network has other traffic for each of the `seeds`, and windows of each. A log is the same for all of them, so that
    its windows are chosen by the first.
    """
    networks = [network_traffic(nets, progress, seed=seed, **how) for seed in seeds] if nets or not logs else []
    runs = [windows for run in networks for windows in run.values()]
    read = partial(record, seed=seeds[0], tell=progress.say, progress=False, **how)
    recordings = [read(LogInput(log)) for log in progress.each(logs, "reading logs", len(logs))] if logs else []
    return [found for found in (*runs, *recordings) if found] or [[]]


def network_traffic(
    nets: Sequence[str], progress: Progress = SILENT, seed: int = 0, **how: Unpack[WindowChoice]
) -> dict[str, list[Scenario]]:
    """Windows of SUMO networks, by network: of the six shipped ones of vehicles where none is named."""
    configs = {net: network(net) for net in nets or NETWORKS}
    return {
        net: record(config, seed=seed, progress=False, **how)
        for net, config in progress.each(configs.items(), "recording traffic", len(configs))
    }
