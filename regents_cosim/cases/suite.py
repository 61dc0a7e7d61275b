"""Read folders of cases with their manifest."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import overload

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case, load_header
from regents_cosim.cases.header import Header
from regents_cosim.cases.manifest import find_cases, load_manifest
from regents_cosim.errors import CaseError
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.system.data_frames import Rows


class CaseList(Rows[Scenario]):
    """A list of cases that notebooks show as a table; a slice of it is one too."""

    def to_dict(self) -> list[dict[str, object]]:
        """A row for each case."""
        rows = [case.summary() for case in self]
        names = dict.fromkeys(name for row in rows for name in row)
        return [{name: row.get(name) for name in names} for row in rows]


def load_suite(path: Path | str) -> CaseList:
    """Load the case at `path`, or all cases of the suite there in the order of its manifest; also `shipped:standard`.

    Raises CaseError where there are none, or one cannot be read.
    """
    return CaseList(cases_at(path))


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
    cases = cases_at(path)[share]
    for _ in cases:
        pass
    return cases


def cases_at(path: Path | str) -> CasesOnDisk:
    """The case at `path`, or those of the suite there. Raises CaseError where there are none."""
    cases = CasesOnDisk(find_cases(Path(path)))
    if not cases:
        raise CaseError(f"{path}: the suite lists no cases (make some with `regents record`)")
    return cases


def hashes_of(cases: Sequence[Scenario]) -> list[str]:
    """The content hash of each case: the one in its file if it is on disk, where an older version may have made it."""
    return [one.hash for one in cases.headers()] if isinstance(cases, CasesOnDisk) else list(map(content_hash, cases))


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
