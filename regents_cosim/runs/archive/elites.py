"""An archive of the best crash of every cell of a map of behaviours, as in MAP-Elites.

Source: Mouret and Clune 2015, "Illuminating search spaces by mapping elites", arXiv 1504.04909; the QD score is that of
Pugh, Soros and Stanley 2016, "Quality diversity: a new frontier for evolutionary computation".
"""

from collections.abc import Iterable

from regents_cosim.runs.archive.axes import Axes, Cell
from regents_cosim.runs.archive.crash import Crash


class Archive:
    """The best crash of each cell; which one that is does not depend on the order in which crashes are added."""

    def __init__(self, axes: Axes, crashes: Iterable[Crash] = ()) -> None:
        self.axes = axes
        self.crashes = 0  # added so far, the best of their cell or not
        self._best: dict[Cell, Crash] = {}
        for crash in crashes:
            self.add(crash)

    def add(self, crash: Crash) -> Cell:
        """Add a crash, and return its cell."""
        cell = self.axes.cell(crash)
        self.crashes += 1
        self._best[cell] = min(self._best.get(cell, crash), crash, key=lambda one: one.order)
        return cell

    def elite(self, cell: Cell) -> Crash | None:
        """The best crash of a cell; None where the cell is empty."""
        return self._best.get(cell)

    @property
    def elites(self) -> dict[Cell, Crash]:
        """The best crash of every filled cell, in the order of the axes."""
        order = [{label: at for at, label in enumerate(axis.labels)} for axis in self.axes.axes]
        places = {cell: [at[label] for at, label in zip(order, cell, strict=True)] for cell in self._best}
        return {cell: self._best[cell] for cell in sorted(places, key=places.__getitem__)}

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
