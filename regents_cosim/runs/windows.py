"""The windows of a run: their names and hashes, and each window on demand."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case, load_header
from regents_cosim.cases.manifest import drop_cases
from regents_cosim.cases.suite import cases_at
from regents_cosim.checks.names import inside
from regents_cosim.runs.identity import Identity
from regents_cosim.runs.ledger import DoneUnit, Ledger, WorkUnit, is_written, open_ledger, redo_lost
from regents_cosim.saving import SuiteWriter, save_unlisted
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.system.files.atomic import remove_written

_KEPT = "windows"  # in the ledger's folder until the run is finished, so that traffic is recorded once


@dataclass(frozen=True)
class RunWindows:
    """Windows by name, in order, loaded on demand."""

    hashes: dict[str, str]
    fetch: Callable[[str], Scenario]  # loads the window of a name


def windows_of(scenarios: Sequence[Scenario]) -> RunWindows:
    """Windows from scenarios in memory, or from a sequence that loads them on access."""
    hashes = {one.id: content_hash(one) for one in scenarios}
    places = {name: place for place, name in enumerate(hashes)}
    return RunWindows(hashes, lambda name: scenarios[places[name]])


def windows_in(cases: Path | str) -> RunWindows:
    """Windows from the case at a path, or from those of a suite. Raises CaseError where there are none."""
    there = cases_at(cases)
    headers = list(there.headers())
    folders = {one.id: folder for one, folder in zip(headers, there.folders, strict=True)}
    return RunWindows({one.id: one.hash for one in headers}, lambda name: load_case(folders[name]))


def planned(ledger: Ledger, windows: RunWindows, key: str = "", before: Sequence[WorkUnit] = ()) -> None:
    """Note the windows of a run after the units `before`, and remove the cases of windows that no longer exist."""
    key_of, plan = ledger.record.begun.identity.key, ledger.record.plan
    units = [*before, *(WorkUnit(name, key_of(digest)) for name, digest in windows.hashes.items())]
    if plan is None or plan.key != key or list(plan.units) != units:
        if gone := ledger.gone(units):
            drop_cases(gone, ledger.folder)
        ledger.plan(key, units)


def recorded(
    ledger: Ledger, key: str, record: Callable[[], Sequence[Scenario]], retry: bool = False, more: bool = False
) -> RunWindows:
    """Windows of traffic; they are recorded if `key`, a digest of the traffic's files and code, is new.

    They are kept beside the ledger until the run is finished. With `more` they come after the windows that it has.
    """
    kept, plan = inside(ledger.place, _KEPT), ledger.record.plan
    if plan is not None and plan.key == key and all((kept / unit.name).is_dir() for unit in ledger.left(retry)):
        return RunWindows({}, lambda name: load_case(kept / name))
    before = plan.units if plan and more else ()
    if not before:
        remove_written(kept, is_written)
    known = {unit.name for unit in before}
    needed = {unit.name for unit in ledger.left(retry)}
    new: dict[str, str] = {}
    for scenario in record():
        if scenario.id not in known:
            new[scenario.id] = content_hash(scenario)
        if scenario.id not in known or scenario.id in needed:
            save_unlisted(scenario, kept)
    windows = RunWindows(new, lambda name: load_case(kept / name))
    planned(ledger, windows, key, before)
    return windows


def record_once(
    folder: Path, identity: Identity, traffic: str, seed: int, record: Callable[[], Sequence[Scenario]]
) -> list[str]:
    """Record into a folder unless that is done; return the names of the cases in order.

    `traffic` is a digest of the traffic's files: changed files are recorded again, and outdated cases are removed.
    Raises CaseError where the folder was begun by another run.
    """
    unit = WorkUnit("traffic", identity.key(traffic))
    done = make_once(folder, identity, unit, seed, lambda: (record(), {}))
    return [name for name, _ in done.cases]


def make_once(
    folder: Path,
    identity: Identity,
    unit: WorkUnit,
    seed: int,
    make: Callable[[], tuple[Sequence[Scenario], dict[str, Any]]],
) -> DoneUnit:
    """Let a folder hold the cases of the only unit of a run, which `make` gives with what else is said of it.

    Where that is done already it is not made again; cases of outdated units are removed. Raises CaseError where the
    folder was begun by another run.
    """
    suite = SuiteWriter(folder, seed)
    with open_ledger(folder, identity) as ledger:
        redo_lost(ledger)
        if not ledger.record.is_done(unit):
            scenarios, said = make()
            before = {name for one in ledger.record.done.values() for name, _ in one.cases}
            if gone := before.difference(scenario.id for scenario in scenarios):
                drop_cases(gone, folder)
            ledger.plan("", [unit])
            ledger.note_begun(unit.name, [scenario.id for scenario in scenarios])
            saved = [(scenario.id, load_header(suite.add(scenario)).hash) for scenario in scenarios]
            ledger.note(DoneUnit(unit, tuple(saved), said))
        ledger.finish()
        return ledger.record.done[unit.name]
