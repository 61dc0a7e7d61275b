"""The results table on disk, with its pictures."""

import json
from pathlib import Path

from regents_cosim.benchmarks.table1 import Table1, as_json
from regents_cosim.benchmarks.table1_sections import markdown
from regents_cosim.evaluation.crashes.scores import USUAL, MethodScores
from regents_cosim.reports.drawing.bars import PercentWithInterval, draw_bars
from regents_cosim.reports.drawing.curve import draw_curve
from regents_cosim.system.files.atomic import explain_write
from regents_cosim.system.files.output_files import MARK, require_ours, write_output_file

_FILES = ("table1.md", "table1.json", "table1.png", "usual.png")


def require_table(folder: Path) -> None:
    """Raise RegentsError where something that is not ours has the name of a file of the table."""
    for name in _FILES:
        require_ours(folder / name)


def write_table(table: Table1, folder: Path) -> None:
    """The table as Markdown, JSON and two pictures: shares of windows, and telling crashes by how usual they are."""
    require_table(folder)
    with explain_write(folder):
        folder.mkdir(parents=True, exist_ok=True)
        write_output_file(folder / "table1.md", f"<!-- {MARK} -->\n{markdown(table)}".encode())
        write_output_file(folder / "table1.json", json.dumps({"generator": MARK, **as_json(table)}, indent=1).encode())
        several = len({row.planner for row in table.scores}) > 1
        groups = {_label(row, several): _shares(row) for row in table.scores}
        bars = {label: [PercentWithInterval(*share) for share in shares] for label, shares in groups.items()}
        draw_bars("Windows that end in a crash", ("success", "actionable", "telling"), bars, folder / "table1.png")
        lines = {_label(row, several): list(row.telling_by_usual.values()) for row in table.scores}
        title = "Windows with a telling crash [%] whose adversary is at least so usual"
        draw_curve(title, lines, [f"{least} %" for least in USUAL], folder / "usual.png")


def _label(row: MethodScores, several: bool) -> str:
    return f"{row.method} / {row.planner}" if several else row.method


def _shares(row: MethodScores) -> list[tuple[float, float, float]]:
    return [
        (row.success_percent, *row.success_interval),
        (row.actionable_percent, *row.actionable_interval),
        (row.telling_percent, *row.telling_interval),
    ]
