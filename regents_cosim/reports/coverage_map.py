"""Shows the map of behaviours of a suite as text: the last two axes across, the others down."""

from dataclasses import dataclass
from itertools import product

from regents_cosim.runs.archive.axes import Cell
from regents_cosim.runs.archive.coverage import Coverage
from regents_cosim.runs.archive.crash import Standing

_LETTERS: dict[Standing, str] = {"flawless": "F", "telling": "T", "preventable": "P", "clean": "C", "crash": "x"}
_MOST_ROWS = 60  # with more rows, only those with a filled cell are shown


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


def _grid(coverage: Coverage) -> _Grid:
    axes = coverage.archive.axes.axes
    grouped = len(axes) > 1
    down = axes[:-2] if grouped else []
    rows = tuple(product(*(axis.labels for axis in down)))
    if len(rows) > _MOST_ROWS:
        filled = {cell[: len(down)] for cell in coverage.archive.elites}
        rows = tuple(row for row in rows if row in filled)
    return _Grid(rows, axes[-2].labels if grouped else ("",), axes[-1].labels, grouped)
