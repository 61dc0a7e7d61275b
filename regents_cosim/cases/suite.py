"""Write and read folders of cases with their manifest."""

import logging
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import overload

from regents_cosim.cases.files import load_case, load_header
from regents_cosim.cases.header import Header
from regents_cosim.cases.manifest import MANIFEST, Suite, add_case, find_cases, load_manifest
from regents_cosim.cases.provenance import made_by, versions
from regents_cosim.cases.shipped import require_own
from regents_cosim.errors import CaseError
from regents_cosim.scenario import Scenario
from regents_cosim.system.atomic import require_writable
from regents_cosim.system.data_frames import Tabular
from regents_cosim.system.interruption import keep, made_whole

_log = logging.getLogger(__name__)


class SuiteWriter:
    """Add cases to a folder, beside those that it holds already; a case of the same name is replaced."""

    def __init__(self, folder: Path, seed: int | None = None) -> None:
        """`seed` is noted in the manifest; by default the seed that is noted there already, or 0.

        Raises RegentsError where `folder` cannot be written, is a case, or its manifest cannot be read.
        """
        require_own(folder, "--output")
        require_writable(folder)
        if (folder / "scenario.json").exists():
            raise CaseError(f"{folder} is a case, expected a folder for cases (choose another with -o)")
        known = load_manifest(folder).seed if (folder / MANIFEST).exists() else 0
        self.folder = folder
        self.seed = known if seed is None else seed
        self._added = 0

    def add(self, scenario: Scenario) -> Path:
        """Save a case and list it beside those that others have added meanwhile; return the case's folder."""
        with made_whole():
            saved = add_case(scenario, self.folder, Suite((), made_by(), self.seed, versions()))
            self._added += 1
        keep(f"finished cases saved in {self.folder}: {self._added}; for the others run the same command again")
        _log.info("saved %s", saved)
        return saved


class CaseList(list[Scenario], Tabular):
    """A list of cases that notebooks show as a table."""

    def table(self) -> list[dict[str, object]]:
        """One row per case."""
        rows = [case.summary() for case in self]
        names = dict.fromkeys(name for row in rows for name in row)
        return [{name: row.get(name) for name in names} for row in rows]


def save_case(scenario: Scenario, suite: Path | str) -> Path:
    """Write `scenario` to `suite/<id>` and list it in the suite's manifest; return its folder.

    A new folder becomes a suite. A case of the same name is replaced, and all others stay. Raises RegentsError where
    the folder cannot be written, is a case, or its manifest cannot be read.
    """
    return SuiteWriter(Path(suite)).add(scenario)


def load_suite(path: Path | str) -> CaseList:
    """Load the case at `path`, or all cases of the suite there in the order of its manifest; also `shipped:standard`.

    Raises CaseError where there are none, or one cannot be read.
    """
    return CaseList(_cases_at(path))


class CasesOnDisk(Sequence[Scenario]):
    """A sequence of cases that loads each case on access and keeps none, so that any suite fits in memory."""

    def __init__(self, folders: Sequence[Path]) -> None:
        self.folders = tuple(folders)

    def __len__(self) -> int:
        """The number of cases."""
        return len(self.folders)

    @overload
    def __getitem__(self, at: int) -> Scenario: ...
    @overload
    def __getitem__(self, at: slice) -> "CasesOnDisk": ...
    def __getitem__(self, at: int | slice) -> "Scenario | CasesOnDisk":
        """Load one case, or give a slice without loading. Raises CaseError for a case that cannot be read."""
        return CasesOnDisk(self.folders[at]) if isinstance(at, slice) else load_case(self.folders[at])

    def headers(self) -> Iterator[Header]:
        """The header of each case, without its tracks. Raises CaseError."""
        return map(load_header, self.folders)


def cases_on_disk(path: Path | str, share: slice = slice(None)) -> CasesOnDisk:
    """The case at `path`, or a slice of the suite there; each case is read once now, so that none fails later.

    Raises CaseError where there are none, or one cannot be read.
    """
    cases = _cases_at(path)[share]
    for _ in cases:
        pass
    return cases


def _cases_at(path: Path | str) -> CasesOnDisk:
    cases = CasesOnDisk(find_cases(Path(path)))
    if not cases:
        raise CaseError(f"{path}: the suite lists no cases (make some with `regents record`)")
    return cases


def suite_cases(suite: Path) -> tuple[str, ...]:
    """The names of the cases that a suite lists. Raises CaseError where there are none."""
    cases = tuple(entry.case for entry in load_manifest(suite).cases)
    if not cases:
        raise CaseError(f"{suite}: the suite lists no cases (make some with `regents attack` or `regents suite build`)")
    return cases


def cases_of(cases: Path | str | Iterable[Scenario]) -> list[Scenario]:
    """A list of cases: given scenarios unchanged, or those loaded from a path."""
    return load_suite(cases) if isinstance(cases, Path | str) else list(cases)


def cases_in_turn(cases: Path | str | Iterable[Scenario], share: slice = slice(None)) -> Sequence[Scenario]:
    """A slice of cases: given scenarios unchanged, or those at a path, each loaded on access."""
    return cases_on_disk(cases, share) if isinstance(cases, Path | str) else list(cases)[share]
