"""An archive of the best crash of every cell, as in MAP-Elites, and a run's folder that holds these crashes alone.

The ledger of such a run notes every crash that was found, kept or not, in plain values. The best ones follow from these
values and not from the order of the windows, so a run that was stopped or divided ends with the same crashes.

Source: Mouret and Clune 2015, "Illuminating search spaces by mapping elites", arXiv 1504.04909; the QD score is that of
Pugh, Soros and Stanley 2016, "Quality diversity: a new frontier for evolutionary computation".
"""

from collections import defaultdict
from collections.abc import Iterable

from regents_cosim.cases.header import HEADER
from regents_cosim.cases.manifest import drop_cases
from regents_cosim.runs.archive.axes import Axes, Cell
from regents_cosim.runs.archive.crash import Crash, crash_of
from regents_cosim.runs.ledger import DoneUnit, Ledger, LedgerRecord
from regents_cosim.runs.window_job import AttackedWindow, crashes_of
from regents_cosim.scenario import Scenario


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


class KeptElites:
    """The elites of a ledger, and the cases in its folder that hold them."""

    def __init__(self, ledger: Ledger, axes: Axes) -> None:
        self.ledger, self.folder = ledger, ledger.folder
        self.archive = _archive(ledger.record, axes)
        self._on_disk = {cell: crash.case for cell, crash in self.archive.elites.items() if self._has(crash.case)}
        self._touched: set[Cell] = set()

    def take(self, found: AttackedWindow, before: DoneUnit | None) -> tuple[Crash, ...]:
        """Replace a window's former crashes by its new ones, without those that SUMO denies; return the new crashes."""
        old = before.crashes if before else ()
        denied = {name for name, (replay, _) in found.verified.items() if not replay.verified}
        cases = [case for case in crashes_of(found.cases) if case.id not in denied]
        new = tuple(crash for case in cases if (crash := crash_of(case)))
        self._touched = {self.archive.axes.cell(crash) for crash in old}
        for crash in old:
            self.archive.drop(crash.case)
        self._touched |= {self.archive.add(crash) for crash in new}
        return new

    def holds(self, case: Scenario) -> bool:
        """Whether a case of the window taken last is the best of its cell."""
        return case.id in self._best().values()

    def clear_beaten(self) -> None:
        """Remove the cases that the crashes of that window have beaten; call it once the ledger knows them."""
        best = self._best()
        beaten = {self._on_disk.pop(cell) for cell in self._touched & self._on_disk.keys()} - set(best.values())
        if beaten:
            drop_cases(beaten, self.folder)
        self._on_disk |= {cell: case for cell, case in best.items() if self._has(case)}

    def _best(self) -> dict[Cell, str]:
        """The names of the best cases, by cell, of the cells that the last window touched."""
        return {cell: best.case for cell in self._touched if (best := self.archive.elite(cell))}

    def _has(self, case: str) -> bool:
        return _is_there(self.ledger, case)


def settle(ledger: Ledger, axes: Axes) -> None:
    """Remove cases that are no elites, and let windows be done again whose elite is missing.

    Both happen after a kill, or where an earlier elite was removed with its window.
    """
    wanted = {crash.case for crash in _archive(ledger.record, axes).elites.values()}
    noted = {crash.case: unit for unit, done in ledger.record.done.items() for crash in done.crashes}
    if unwanted := {case for case in noted.keys() - wanted if _is_there(ledger, case)}:
        drop_cases(unwanted, ledger.folder)
    for unit in {noted[case] for case in wanted if not _is_there(ledger, case)}:
        ledger.forget(unit)


def _is_there(ledger: Ledger, case: str) -> bool:
    return (ledger.folder / case / HEADER).is_file()


def axes_of(record: LedgerRecord) -> Axes | None:
    """The axes of the map by which a run keeps crashes; None where it keeps all of them."""
    names = record.begun.identity.settings.get("archive")
    return Axes(tuple(names)) if names else None


def kept_cases(record: LedgerRecord) -> list[str]:
    """The names of the cases that a run has left in its folder, in the order of its windows."""
    axes = axes_of(record)
    best = {crash.case for crash in _archive(record, axes).elites.values()} if axes else set[str]()
    return [name for done in _done(record) for name in done.names if name in best or name in dict(done.cases)]


def beaten_cases(record: LedgerRecord) -> set[str]:
    """The names of crashes that a run found but did not keep."""
    return {name for done in _done(record) for name in done.names}.difference(kept_cases(record))


def _archive(record: LedgerRecord, axes: Axes) -> Archive:
    return Archive(axes, (crash for done in _done(record) for crash in done.crashes))


def _done(record: LedgerRecord) -> Iterable[DoneUnit]:
    return (record.done[unit.name] for unit in record.own if record.is_done(unit))
