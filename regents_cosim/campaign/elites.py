"""Keep in a run's folder only the best crash of each cell of a map of behaviours.

The ledger notes every crash that was found, kept or not, in plain values. The best ones follow from these values and
not from the order of the windows, so a run that was stopped or divided ends with the same crashes.
"""

from collections.abc import Iterable

from regents_cosim.archive.axes import Axes, Cell
from regents_cosim.archive.crash import Crash, crash_of
from regents_cosim.archive.elites import Archive
from regents_cosim.campaign.ledger import DoneUnit, Ledger, LedgerRecord
from regents_cosim.campaign.window_job import AttackedWindow, crashes_of
from regents_cosim.cases.header import HEADER
from regents_cosim.cases.manifest import drop_cases
from regents_cosim.scenario import Scenario


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
        denied = {name for name, replay in found.replays.items() if not replay.verified}
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
