"""Compare the map of behaviours that a suite covers with that of an older suite."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from regents_cosim.plain_text import counted
from regents_cosim.runs.archive.axes import Axes, Cell
from regents_cosim.runs.archive.crash import STANDINGS, crash_in
from regents_cosim.runs.archive.elites import Archive


@dataclass(frozen=True, eq=False)
class Coverage:
    """The map of one suite, and optionally that of an older suite for comparison."""

    archive: Archive
    old: Archive | None = None  # map of the older suite

    @property
    def new_cells(self) -> tuple[Cell, ...]:
        """The cells that the suite fills and the old one does not."""
        return () if self.old is None else _beyond(self.archive, self.old)

    @property
    def lost_cells(self) -> tuple[Cell, ...]:
        """The cells that the old suite fills and the new one does not."""
        return () if self.old is None else _beyond(self.old, self.archive)

    def rows(self) -> list[dict[str, Any]]:
        """One row for every filled cell."""
        names = self.archive.axes.names
        new = set(self.new_cells)
        rows = []
        for cell, crash in self.archive.elites.items():
            row: dict[str, Any] = dict(zip(names, cell, strict=True))
            row |= {"case": crash.case, "standing": crash.standing, "usual_percent": crash.usual_percent}
            row |= {"deviation_m": crash.deviation_m, "quality": round(crash.quality, 3)}
            rows.append(row | ({"new": cell in new} if self.old is not None else {}))
        return rows

    def summary(self) -> str:
        """The counts of the map in one sentence."""
        elites = self.archive.elites
        counts = ((name, sum(crash.standing == name for crash in elites.values())) for name in reversed(STANDINGS))
        each = ", ".join(f"{count} {name if name != 'crash' else 'other'}" for name, count in counts if count)
        said = f"{len(elites)} of {self.archive.axes.count} cells filled by {counted(self.archive.crashes, 'crash')}"
        said += f" ({each})" if each else ""
        said += f", QD score {self.archive.qd_score:g}"
        if self.old is None:
            return said
        return f"{said}; {len(self.new_cells)} cells are new, {len(self.lost_cells)} of the old suite are not filled"

    def plain(self, suite: str) -> dict[str, Any]:
        """All results as plain values for JSON."""
        axes = self.archive.axes
        found: dict[str, Any] = {
            "suite": suite,
            "axes": {axis.name: list(axis.labels) for axis in axes.axes},
            "cells": axes.count,
            "filled": len(self.archive.elites),
            "crashes": self.archive.crashes,
            "qd_score": self.archive.qd_score,
            "elites": self.rows(),
        }
        if self.old is None:
            return found
        return found | {"new": list(map(list, self.new_cells)), "lost": list(map(list, self.lost_cells))}


def archive_of(folders: Iterable[Path], axes: Axes) -> Archive:
    """The map of the crashes in these case folders. Raises CaseError."""
    return Archive(axes, filter(None, map(crash_in, folders)))


def coverage_of(folders: Iterable[Path], axes: Axes, old: Iterable[Path] | None = None) -> Coverage:
    """The coverage of these case folders, compared with those of an older suite if given. Raises CaseError."""
    return Coverage(archive_of(folders, axes), None if old is None else archive_of(old, axes))


def _beyond(one: Archive, other: Archive) -> tuple[Cell, ...]:
    """The cells that `one` fills and `other` does not."""
    filled = other.elites
    return tuple(cell for cell in one.elites if cell not in filled)
