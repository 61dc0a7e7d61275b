"""Methods run on windows for the tables: attacked, judged, verified in SUMO, timed."""

import json
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from regents_cosim.cli.options import Search
from regents_cosim.cli.shared import verify_in_sumo
from regents_cosim.errors import RegentsError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from regents_cosim.attacks.presets import AttackConfig
    from regents_cosim.benchmarks.table1 import Table1
    from regents_cosim.cli.terminal import Terminal
    from regents_cosim.evaluation.crashes.scores import MethodScores, Protocol, Results, Run
    from regents_cosim.scenario import Scenario

_OF_PAPERS = ("king", "regents")
_PRESETS = (*_OF_PAPERS, "focused")
_ALL = (*_PRESETS, "random", "cma-es", "starts")


@dataclass(frozen=True)
class Column:
    """What a column of the table is about."""

    name: str
    config: "AttackConfig | None"  # None: SUMO's own drivers, who search nothing


def columns(
    methods: "Sequence[str]",
    searches: "Sequence[str]",
    backgrounds: "Sequence[str]",
    equal_protocol: bool,
    given: "Mapping[str, Any]",
) -> list[Column]:
    """The columns of a table, for one planner; `given` takes the place of the presets' settings.

    With an equal protocol all search by the rules of ours, and those of the papers as there besides.
    """
    if equal_protocol and (searches or backgrounds):
        raise RegentsError("--equal-protocol says how all methods search: leave out --searches and --backgrounds")
    chosen = methods or (_ALL if equal_protocol else _PRESETS)
    if equal_protocol:
        return [*_as_published(chosen, given), *_by_our_protocol(chosen, given)]
    found = []
    for method, search, background in product(chosen, searches or (None,), backgrounds or (None,)):
        config = _config(method, {**given, "search": search, "background": background})
        found.append(Column(_name(config) if config else method, config))
    return found


def _as_published(methods: "Sequence[str]", given: "Mapping[str, Any]") -> list[Column]:
    configs = (_config(method, given) for method in methods if method in _OF_PAPERS)
    return [Column(_name(config), config) for config in configs if config]


def _by_our_protocol(methods: "Sequence[str]", given: "Mapping[str, Any]") -> list[Column]:
    from regents_cosim.attacks.presets import OURS

    ours = _config(OURS.method, given)
    assert ours is not None
    found = []
    for method in methods:
        config = _config(method, given)
        name = method if config is None or method == ours.method else f"{config.label}, protocol of {ours.method}"
        found.append(Column(name, config and config.by_protocol_of(ours)))
    return found


def _config(method: str, given: "Mapping[str, Any]") -> "AttackConfig | None":
    from regents_cosim.benchmarks.aggressive import METHOD

    return None if method == METHOD else Search(method, **given).config()  # pyright: ignore[reportArgumentType]


def places_run(
    places: "Sequence[list[Scenario]]",
    planner: str,
    wanted: "Sequence[Column]",
    output: Path | None,
    terminal: "Terminal",
) -> "Iterator[list[Run]]":
    """The runs of all columns, place by place: after each, those on the places so far."""
    from regents_cosim.benchmarks.kept_runs import joined

    done: list[list[Run]] = [[] for _ in wanted]
    for windows in places:
        here: list[Run] = []
        for column, runs in zip(wanted, done, strict=True):
            here.append(_one_run(windows, planner, column, here, output, terminal))
            runs.append(here[-1])
        yield [joined(runs) for runs in done]


def runs_again(
    places: "Sequence[list[Scenario]]",
    planner: str,
    methods: "Sequence[str]",
    runs: "Sequence[Run]",
    most: int | None,
    output: Path | None,
    terminal: "Terminal",
) -> "Iterator[Run]":
    """Ten times the budget for the windows of each place in which no run has a telling crash, `most` of each at most.

    One method after the other, each where those before it found nothing.
    """
    from regents_cosim.attacks.presets import METHODS, OURS, with_ten_times
    from regents_cosim.benchmarks.ceiling import unsolved

    for windows in places:
        left, made = unsolved(windows, runs)[:most], []
        for method in methods:
            left = unsolved(left, made)
            if left:
                config = with_ten_times(METHODS[method].by_protocol_of(OURS))
                column = Column(f"{method} with ten times the roll-outs", config)
                made.append(_one_run(left, planner, column, made, output, terminal))
                yield made[-1]


def _one_run(
    windows: "list[Scenario]",
    planner: str,
    column: Column,
    others: "list[Run]",
    output: Path | None,
    terminal: "Terminal",
) -> "Run":
    """A method on the windows of one place: the run that `output` keeps of it, else a new one."""
    from regents_cosim.benchmarks.kept_runs import keep, kept, run_folder

    folder = run_folder(output, column.name, planner, column.config, windows) if output else None
    run = kept(folder) if folder else None
    if run is None:
        if column.config is None:
            run = aggressive_run(windows, planner, others, terminal)
        else:
            run = attack_run(windows, planner, column, terminal)
        if folder:
            keep(run, folder)
    return run


def attack_run(windows: "list[Scenario]", planner: str, column: Column, terminal: "Terminal") -> "Run":
    """An attack on all `windows`."""
    from regents_cosim.attacks.attack import attack_each
    from regents_cosim.evaluation.crashes.scores import rollouts_at_most

    config = column.config
    assert config is not None
    begin = perf_counter()
    attacks = attack_each(windows, config, planner)
    found: list[Results] = list(terminal.each(attacks, f"{column.name} against {planner}", len(windows)))
    seconds = perf_counter() - begin
    return _judged(column.name, planner, rollouts_at_most(config), found, seconds, terminal, config.protocol)


def aggressive_run(windows: "list[Scenario]", planner: str, others: "list[Run]", terminal: "Terminal") -> "Run":
    """SUMO's own drivers at their most dangerous, on the same windows as the `others`."""
    from regents_cosim.benchmarks.aggressive import METHOD, drive_aggressively

    nothing: list[Results] = [[] for _ in windows]
    before = next((run.windows for run in others if run.planner == planner), nothing)
    begin = perf_counter()
    driven = drive_aggressively(windows, before, planner)
    found = list(terminal.each(driven, f"{METHOD} against {planner}", len(windows)))
    return _judged(METHOD, planner, 1, found, perf_counter() - begin, terminal)


def write_table(table: "Table1", folder: Path) -> None:
    """The table as Markdown, JSON and two pictures: shares of windows, and telling crashes by how usual they are."""
    from regents_cosim.benchmarks.table1 import as_json, markdown
    from regents_cosim.evaluation.crashes.scores import USUAL
    from regents_cosim.reports.bars import Share, draw_bars
    from regents_cosim.reports.curve import draw_curve
    from regents_cosim.system.atomic import explain_write, write_atomic

    with explain_write(folder):
        folder.mkdir(parents=True, exist_ok=True)
        write_atomic(folder / "table1.md", markdown(table).encode())
        write_atomic(folder / "table1.json", json.dumps(as_json(table), indent=1).encode())
        several = len({row.planner for row in table.scores}) > 1
        groups = {_label(row, several): _shares(row) for row in table.scores}
        bars = {label: [Share(*share) for share in shares] for label, shares in groups.items()}
        draw_bars("Windows that end in a crash", ("success", "actionable", "telling"), bars, folder / "table1.png")
        lines = {_label(row, several): list(row.telling_by_usual.values()) for row in table.scores}
        title = "Windows with a telling crash [%] whose adversary is at least so usual"
        draw_curve(title, lines, [f"{least} %" for least in USUAL], folder / "usual.png")


def _judged(
    method: str,
    planner: str,
    rollouts: int,
    found: "list[Results]",
    seconds: float,
    terminal: "Terminal",
    protocol: "Protocol" = (),
) -> "Run":
    from regents_cosim.evaluation.crashes.scores import InSumo, Run
    from regents_cosim.verdicts.judgement import judge_each

    cases = [case for results in found for case in results]
    judged = iter(list(terminal.each(judge_each(cases), "judging", len(cases))))
    windows = [[next(judged) for _ in results] for results in found]
    replays = verify_in_sumo([case for results in windows for case in results], "local", terminal)
    in_sumo = [InSumo(one.case, one.verified, one.reports_same_pair) for one in replays.values()]
    return Run(method, planner, rollouts, windows, in_sumo, seconds, protocol)


def _name(config: "AttackConfig") -> str:
    """The preset, and where it was changed how."""
    from regents_cosim.attacks.presets import METHODS

    preset = METHODS[config.method]
    changed = [f"{getattr(config, f)}" for f in ("search", "background") if getattr(config, f) != getattr(preset, f)]
    return ", ".join([config.label, *changed])


def _label(row: "MethodScores", several: bool) -> str:
    return f"{row.method} / {row.planner}" if several else row.method


def _shares(row: "MethodScores") -> list[tuple[float, float, float]]:
    return [
        (row.success_percent, *row.success_interval),
        (row.actionable_percent, *row.actionable_interval),
        (row.telling_percent, *row.telling_interval),
    ]
