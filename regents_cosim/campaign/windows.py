"""The windows of a run: which they are, and each of them when its turn comes."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from regents_cosim.campaign.ledger import Ledger, WorkUnit, is_written
from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case, load_header, save_unlisted
from regents_cosim.cases.manifest import drop_cases, find_cases
from regents_cosim.checks.names import inside
from regents_cosim.errors import CaseError
from regents_cosim.scenario import Scenario
from regents_cosim.system.atomic import remove_written

_KEPT = "windows"  # in the ledger's folder, while the run is not finished: traffic is recorded once


@dataclass(frozen=True)
class RunWindows:
    """Cases by name, in their order."""

    hashes: dict[str, str]
    fetch: Callable[[str], Scenario]  # the case of a name

    def units(self, key: Callable[[str], str]) -> list[WorkUnit]:
        """A unit of work for each, in order; `key` of the run and a window's hash."""
        return [WorkUnit(name, key(digest)) for name, digest in self.hashes.items()]

    def load(self, names: Iterable[str]) -> Iterator[Scenario]:
        """Those of these names, one at a time."""
        return map(self.fetch, names)


def windows_of(scenarios: Sequence[Scenario]) -> RunWindows:
    """Cases in memory, or that are loaded when they are asked for."""
    hashes = {one.id: content_hash(one) for one in scenarios}
    places = {name: place for place, name in enumerate(hashes)}
    return RunWindows(hashes, lambda name: scenarios[places[name]])


def windows_in(cases: Path) -> RunWindows:
    """The case at a path, or those of a suite. Raises CaseError where there are none."""
    headers = [(folder, load_header(folder)) for folder in find_cases(cases)]
    if not headers:
        raise CaseError(f"{cases}: the suite lists no cases (make some with `regents record`)")
    folders = {one.id: folder for folder, one in headers}
    return RunWindows({one.id: one.hash for _, one in headers}, lambda name: load_case(folders[name]))


def planned(ledger: Ledger, windows: RunWindows, key: str = "", before: Sequence[WorkUnit] = ()) -> None:
    """Note the windows of a run, after those `before`; cases of windows that are no more are removed."""
    units = [*before, *windows.units(ledger.record.begun.identity.key)]
    plan = ledger.record.plan
    if plan is None or plan.key != key or list(plan.units) != units:
        if gone := ledger.gone(units):
            drop_cases(gone, ledger.folder)
        ledger.plan(key, units)


def recorded(
    ledger: Ledger, key: str, record: Callable[[], Sequence[Scenario]], retry: bool = False, more: bool = False
) -> RunWindows:
    """Windows of traffic, recorded when `key` is new: of its files, and of whose code does it.

    They are kept beside the ledger until the run is finished. With `more` they come after those that it has.
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
