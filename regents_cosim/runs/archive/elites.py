"""An archive of the best crash of every cell of a map of behaviours, as in MAP-Elites.

Source: Mouret and Clune 2015, "Illuminating search spaces by mapping elites", arXiv 1504.04909; the QD score is that of
Pugh, Soros and Stanley 2016, "Quality diversity: a new frontier for evolutionary computation".
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from regents_cosim.plain_text import counted
from regents_cosim.runs.archive.axes import AXES, CELLS, NAMES, Cell, cell_of
from regents_cosim.runs.archive.crash import STANDINGS, Crash, crash_in


class Archive:
    """The best crash of each cell; which one that is does not depend on the order in which crashes are added."""

    def __init__(self, crashes: Iterable[Crash] = ()) -> None:
        self.crashes = 0  # added so far, the best of their cell or not
        self._best: dict[Cell, Crash] = {}
        for crash in crashes:
            self.add(crash)

    def add(self, crash: Crash) -> Cell:
        """Add a crash, and return its cell."""
        cell = cell_of(crash)
        self.crashes += 1
        self._best[cell] = min(self._best.get(cell, crash), crash, key=lambda one: one.order)
        return cell

    def elite(self, cell: Cell) -> Crash | None:
        """The best crash of a cell; None where the cell is empty."""
        return self._best.get(cell)

    @property
    def elites(self) -> dict[Cell, Crash]:
        """The best crash of every filled cell, in the order of the axes."""
        order = [{label: at for at, label in enumerate(axis.labels)} for axis in AXES]
        places = {cell: [at[label] for at, label in zip(order, cell, strict=True)] for cell in self._best}
        return {cell: self._best[cell] for cell in sorted(places, key=places.__getitem__)}

    @property
    def qd_score(self) -> float:
        """The sum of the quality of all elites."""
        return round(sum((crash.quality for crash in self.elites.values()), 0.0), 3)

    def improves(self, crash: Crash) -> str:
        """How a crash would improve its cell: `new cell`, `plainer`, `gentler`, or empty if it would not."""
        best = self.elite(cell_of(crash))
        if best is None:
            return "new cell"
        if crash.order >= best.order:
            return ""
        return "gentler" if crash.standing == best.standing else "plainer"

    def rows(self) -> list[dict[str, Any]]:
        """One row for every filled cell."""
        return [
            {
                **dict(zip(NAMES, cell, strict=True)),
                "case": crash.case,
                "standing": crash.standing,
                "usual_percent": crash.usual_percent,
                "deviation_m": crash.deviation_m,
                "quality": round(crash.quality, 3),
            }
            for cell, crash in self.elites.items()
        ]

    def summary(self) -> str:
        """The counts of the map in one sentence."""
        counts = ((name, sum(crash.standing == name for crash in self.elites.values())) for name in STANDINGS[::-1])
        each = ", ".join(f"{count} {name if name != 'crash' else 'other'}" for name, count in counts if count)
        said = f"{len(self.elites)} of {CELLS} cells filled by {counted(self.crashes, 'crash')}"
        return said + (f" ({each})" if each else "") + f", QD score {self.qd_score:g}"

    def plain(self, suite: str) -> dict[str, Any]:
        """All results as plain values for JSON."""
        return {
            "suite": suite,
            "axes": {axis.name: list(axis.labels) for axis in AXES},
            "cells": CELLS,
            "filled": len(self.elites),
            "crashes": self.crashes,
            "qd_score": self.qd_score,
            "elites": self.rows(),
        }


def archive_of(folders: Iterable[Path]) -> Archive:
    """The archive of the crashes in these case folders. Raises CaseError."""
    return Archive(filter(None, map(crash_in, folders)))
