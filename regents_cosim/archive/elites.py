"""An archive of the best crash of every cell, as in MAP-Elites.

Source: Mouret and Clune 2015, "Illuminating search spaces by mapping elites", arXiv 1504.04909; the QD score is that of
Pugh, Soros and Stanley 2016, "Quality diversity: a new frontier for evolutionary computation".
"""

from collections import defaultdict
from collections.abc import Iterable

from regents_cosim.archive.axes import Axes, Cell
from regents_cosim.archive.crash import Crash


class Archive:
    """Crashes by cell; the elites do not depend on the order in which crashes are added."""

    def __init__(self, axes: Axes, crashes: Iterable[Crash] = ()) -> None:
        self.axes = axes
        self._cells: defaultdict[Cell, dict[str, Crash]] = defaultdict(dict)
        self._home: dict[str, Cell] = {}
        for crash in crashes:
            self.add(crash)

    def add(self, crash: Crash) -> Cell:
        """Add a crash, replacing one of the same name, and return its cell."""
        self.drop(crash.case)
        cell = self._home[crash.case] = self.axes.cell(crash)
        self._cells[cell][crash.case] = crash
        return cell

    def drop(self, case: str) -> None:
        """Remove a crash if the archive holds it."""
        cell = self._home.pop(case, None)
        if cell is not None:
            del self._cells[cell][case]

    def elite(self, cell: Cell) -> Crash | None:
        """The best crash of a cell; None where the cell is empty."""
        return min(self._cells[cell].values(), key=lambda crash: crash.order) if self._cells.get(cell) else None

    @property
    def elites(self) -> dict[Cell, Crash]:
        """The best crash of every filled cell, in the order of the axes."""
        order = [{label: at for at, label in enumerate(axis.labels)} for axis in self.axes.axes]
        filled = (cell for cell, crashes in self._cells.items() if crashes)
        in_order = sorted(filled, key=lambda cell: [places[label] for places, label in zip(order, cell, strict=True)])
        return {cell: found for cell in in_order if (found := self.elite(cell))}

    @property
    def crashes(self) -> int:
        """The number of crashes in the archive, elites and others."""
        return len(self._home)

    @property
    def qd_score(self) -> float:
        """The sum of the quality of all elites."""
        return round(sum((crash.quality for crash in self.elites.values()), 0.0), 3)

    def improves(self, crash: Crash) -> str:
        """How a crash would improve its cell: `new cell`, `plainer`, `gentler`, or empty if it would not."""
        best = self.elite(self.axes.cell(crash))
        if best is None:
            return "new cell"
        if crash.order >= best.order:
            return ""
        return "gentler" if crash.standing == best.standing else "plainer"
