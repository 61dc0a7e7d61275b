"""The best crash of every cell: an archive as MAP-Elites keeps it.

Source: Mouret and Clune 2015, "Illuminating search spaces by mapping elites", arXiv 1504.04909; the QD score is that of
Pugh, Soros and Stanley 2016, "Quality diversity: a new frontier for evolutionary computation".
"""

from collections import defaultdict
from collections.abc import Iterable

from regents_cosim.archive.axes import Axes, Cell
from regents_cosim.archive.crash import Crash


class Archive:
    """Crashes by cell. Which of them are elites does not depend on the order in which they came."""

    def __init__(self, axes: Axes, crashes: Iterable[Crash] = ()) -> None:
        self.axes = axes
        self._cells: defaultdict[Cell, dict[str, Crash]] = defaultdict(dict)
        self._home: dict[str, Cell] = {}
        for crash in crashes:
            self.add(crash)

    def add(self, crash: Crash) -> Cell:
        """Take a crash in, in the place of one of its name; its cell."""
        self.drop(crash.case)
        cell = self._home[crash.case] = self.axes.cell(crash)
        self._cells[cell][crash.case] = crash
        return cell

    def drop(self, case: str) -> None:
        """Forget a crash, if it is known."""
        cell = self._home.pop(case, None)
        if cell is not None:
            del self._cells[cell][case]

    def elite(self, cell: Cell) -> Crash | None:
        """The best of a cell; None where it is empty."""
        return min(self._cells[cell].values(), key=lambda crash: crash.order) if self._cells.get(cell) else None

    @property
    def elites(self) -> dict[Cell, Crash]:
        """The best of every cell that is filled, in the order of the axes."""
        order = [{label: at for at, label in enumerate(axis.labels)} for axis in self.axes.axes]
        filled = (cell for cell, crashes in self._cells.items() if crashes)
        in_order = sorted(filled, key=lambda cell: [places[label] for places, label in zip(order, cell, strict=True)])
        return {cell: found for cell in in_order if (found := self.elite(cell))}

    @property
    def crashes(self) -> int:
        """How many it holds, the elites and all others."""
        return len(self._home)

    @property
    def qd_score(self) -> float:
        """The quality of all elites together."""
        return round(sum((crash.quality for crash in self.elites.values()), 0.0), 3)

    def improves(self, crash: Crash) -> str:
        """What a crash would add: `new cell`, `plainer` or `gentler` than the elite there, or nothing."""
        best = self.elite(self.axes.cell(crash))
        if best is None:
            return "new cell"
        if crash.order >= best.order:
            return ""
        return "gentler" if crash.standing == best.standing else "plainer"
