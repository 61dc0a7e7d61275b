"""Shows the map of behaviours of a suite, as text and as a picture: the last two axes across, the others down."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from regents_cosim.reports.drawing.canvas import Canvas, png_bytes, text_width
from regents_cosim.reports.drawing.palette import (
    ADVERSARY,
    EGO,
    EVASION,
    FAINT_INK,
    HAIRLINE,
    INK,
    OTHER,
    PANEL,
    SIGNAL_AMBER,
    Colour,
)
from regents_cosim.runs.archive.axes import Axis, Cell
from regents_cosim.runs.archive.coverage import Coverage
from regents_cosim.runs.archive.crash import STANDINGS, Standing
from regents_cosim.system.files.atomic import explain_write
from regents_cosim.system.files.output_files import write_output_file

_LETTERS: dict[Standing, str] = {"flawless": "F", "telling": "T", "preventable": "P", "clean": "C", "crash": "x"}
_COLOURS: dict[Standing, Colour] = {
    "flawless": INK,
    "telling": EVASION,
    "preventable": EGO,
    "clean": SIGNAL_AMBER,
    "crash": OTHER,
}
_MOST_ROWS = 60  # with more rows, only those with a filled cell are shown
_BOX_PX, _GROUP_GAP_PX, _EDGE_PX, _HEAD_PX, _FOOT_PX = 22, 10, 16, 88, 44
_ZOOM = 2


@dataclass(frozen=True)
class _Grid:
    """The layout of the cells: rows, and groups of columns."""

    rows: tuple[Cell, ...]
    groups: tuple[str, ...]  # labels of the last axis but one; a single empty label where there is no such axis
    columns: tuple[str, ...]  # of the last axis
    grouped: bool

    def cell(self, row: Cell, group: str, column: str) -> Cell:
        return (*row, group, column) if self.grouped else (*row, column)


def coverage_text(coverage: Coverage) -> str:
    """The map in letters: F flawless, T telling, P preventable, C clean, x any other; a dot is an empty cell."""
    grid, elites = _grid(coverage), coverage.archive.elites
    names = [" ".join(row) for row in grid.rows]
    room = max(map(len, names), default=0)
    wide = max(len(grid.columns), *map(len, grid.groups)) + 2
    lines = [f"{'':{room}}  " + "".join(f"{group:{wide}}" for group in grid.groups)] if grid.grouped else []
    for name, row in zip(names, grid.rows, strict=True):
        groups = (
            "".join(
                _LETTERS[elites[cell].standing] if (cell := grid.cell(row, group, column)) in elites else "."
                for column in grid.columns
            )
            for group in grid.groups
        )
        lines.append(f"{name:{room}}  " + "".join(f"{letters:{wide}}" for letters in groups))
    last = coverage.archive.axes.axes[-1]
    key = f"{'across' if not grid.grouped else 'in each'}: {last.name} {', '.join(last.labels)}"
    letters = "F flawless, T telling, P preventable, C clean, x other, . empty"
    return "\n".join(line.rstrip() for line in (*lines, key, letters))


def draw_coverage(coverage: Coverage, title: str, path: Path) -> None:
    """Write a PNG of the map; cells that an older suite does not fill get a frame. Raises RegentsError."""
    picture = png_bytes(_draw(coverage, title).finish())
    with explain_write(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_output_file(path, picture)


def _draw(coverage: Coverage, title: str) -> Canvas:
    grid, elites = _grid(coverage), coverage.archive.elites
    names = [" ".join(row) for row in grid.rows]
    left = _EDGE_PX + max((text_width(name, 12) for name in names), default=0.0) + 10
    group_px = float(len(grid.columns) * _BOX_PX + _GROUP_GAP_PX)
    across = max(left + len(grid.groups) * group_px, text_width(coverage.summary(), 12) + _EDGE_PX) + _EDGE_PX
    size = (round(across), _HEAD_PX + len(names) * _BOX_PX + _FOOT_PX)
    canvas = Canvas.blank(size, _ZOOM, PANEL)
    canvas.text((_EDGE_PX, 24), title, 14, INK, bold=True)
    canvas.text((_EDGE_PX, 46), coverage.summary(), 12, FAINT_INK)
    _draw_heads(canvas, grid, coverage.archive.axes.axes[-1], left, group_px)
    new = set(coverage.new_cells)
    for down, (name, row) in enumerate(zip(names, grid.rows, strict=True)):
        top = _HEAD_PX + down * _BOX_PX
        canvas.text((left - 10, top + 16), name, 12, INK, "rs")
        for (number, group), (at, column) in product(enumerate(grid.groups), enumerate(grid.columns)):
            cell = grid.cell(row, group, column)
            x = left + number * group_px + at * _BOX_PX
            found = elites.get(cell)
            if cell in new:
                canvas.box(x, top, x + _BOX_PX, top + _BOX_PX, ADVERSARY)
            canvas.box(
                x + 2, top + 2, x + _BOX_PX - 2, top + _BOX_PX - 2, _COLOURS[found.standing] if found else HAIRLINE
            )
    _draw_legend(canvas, size[1] - 16, bool(new))
    return canvas


def _draw_heads(canvas: Canvas, grid: _Grid, last: Axis, left: float, group_px: float) -> None:
    """Draw the names of the groups, and those of the columns above the begin of each column."""
    for number, group in enumerate(grid.groups):
        canvas.text((left + number * group_px, _HEAD_PX - 22), group, 12, INK)
        for at, label in enumerate(last.labels):
            middle = left + number * group_px + (at + 0.5) * _BOX_PX
            canvas.text((middle, _HEAD_PX - 6), label.partition("-")[0].partition(" ")[0][:3], 10, FAINT_INK, "ms")


def _draw_legend(canvas: Canvas, baseline: int, framed: bool) -> None:
    x = float(_EDGE_PX)
    words: Sequence[tuple[str, Colour]] = [(name, _COLOURS[name]) for name in reversed(STANDINGS)]
    for name, colour in [*words, *([("new", ADVERSARY)] if framed else [])]:
        canvas.box(x, baseline - 11, x + 12, baseline + 1, colour)
        canvas.text((x + 18, baseline), name, 12, INK)
        x += 18 + text_width(name, 12) + 20


def _grid(coverage: Coverage) -> _Grid:
    axes = coverage.archive.axes.axes
    grouped = len(axes) > 1
    down = axes[:-2] if grouped else []
    rows = tuple(product(*(axis.labels for axis in down)))
    if len(rows) > _MOST_ROWS:
        filled = {cell[: len(down)] for cell in coverage.archive.elites}
        rows = tuple(row for row in rows if row in filled)
    return _Grid(rows, axes[-2].labels if grouped else ("",), axes[-1].labels, grouped)
