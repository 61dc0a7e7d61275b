"""Methods run on windows for the tables: attacked, judged, verified in SUMO, timed."""

import json
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from regents_cosim.cli.shared import verify_in_sumo

if TYPE_CHECKING:
    from regents_cosim.attacks.presets import AttackConfig
    from regents_cosim.evaluation.scores import MethodScores, Results, Run
    from regents_cosim.evaluation.table1 import Table1
    from regents_cosim.scenario import Scenario
    from regents_cosim.terminal import Terminal


def attack_run(windows: "list[Scenario]", planner: str, config: "AttackConfig", terminal: "Terminal") -> "Run":
    """An attack on all `windows`."""
    from regents_cosim.attacks.attack import attack_each
    from regents_cosim.evaluation.scores import rollouts_at_most

    begin = perf_counter()
    name = f"{config.label} against {planner}"
    found: list[Results] = list(terminal.each(attack_each(windows, config, planner), name, len(windows)))
    seconds = perf_counter() - begin
    return _judged(_name(config), planner, rollouts_at_most(config), found, seconds, terminal)


def aggressive_run(windows: "list[Scenario]", planner: str, others: "list[Run]", terminal: "Terminal") -> "Run":
    """SUMO's own drivers at their most dangerous, on the same windows as the `others`."""
    from regents_cosim.evaluation.aggressive import METHOD, drive_aggressively

    nothing: list[Results] = [[] for _ in windows]
    before = next((run.windows for run in others if run.planner == planner), nothing)
    begin = perf_counter()
    driven = drive_aggressively(windows, before, planner)
    found = list(terminal.each(driven, f"{METHOD} against {planner}", len(windows)))
    return _judged(METHOD, planner, 1, found, perf_counter() - begin, terminal)


def write_table(table: "Table1", folder: Path) -> None:
    """The table as Markdown, JSON and a picture."""
    from regents_cosim.atomic import explain_write, write_atomic
    from regents_cosim.evaluation.table1 import as_json, markdown
    from regents_cosim.reports.bars import Share, draw_bars

    with explain_write(folder):
        folder.mkdir(parents=True, exist_ok=True)
        write_atomic(folder / "table1.md", markdown(table).encode())
        write_atomic(folder / "table1.json", json.dumps(as_json(table), indent=1).encode())
        several = len({row.planner for row in table.scores}) > 1
        groups = {_label(row, several): _shares(row) for row in table.scores}
        bars = {label: [Share(*share) for share in shares] for label, shares in groups.items()}
        draw_bars("Windows that end in a crash", ("success", "clean", "actionable"), bars, folder / "table1.png")


def _judged(
    method: str, planner: str, rollouts: int, found: "list[Results]", seconds: float, terminal: "Terminal"
) -> "Run":
    from regents_cosim.evaluation.scores import Run
    from regents_cosim.verdicts.judgement import judge_each

    cases = [case for results in found for case in results]
    judged = iter(list(terminal.each(judge_each(cases), "judging", len(cases))))
    windows = [[next(judged) for _ in results] for results in found]
    replays = verify_in_sumo([case for results in windows for case in results], "local", terminal)
    return Run(method, planner, rollouts, windows, list(replays.values()), seconds)


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
        (row.clean_percent, *row.clean_interval),
        (row.actionable_percent, *row.actionable_interval),
    ]
