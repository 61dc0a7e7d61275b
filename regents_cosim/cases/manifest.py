"""suite.json: the manifest of a folder of cases, in the layout of `docs/file-formats.md`, which is a contract.

A case counts as added from the moment it is renamed into its place (`files`). Before that, the manifest names it as
`pending` with its hash, and a reader counts it if the folder holds it.
"""

from collections import Counter
from collections.abc import Collection
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import msgspec

from regents_cosim.cases.files import CASE_FILES, is_of_case, load_header
from regents_cosim.cases.header import HEADER
from regents_cosim.cases.json_files import FLAT_SCHEMA, JSON_BYTES, decode, explain_read, in_lines
from regents_cosim.cases.map_files import is_map_file
from regents_cosim.cases.shipped import ALL_NETWORKS, SUITES, located, names
from regents_cosim.checks.bounded import read_bounded
from regents_cosim.checks.names import inside, nearest, require_file_name, require_inside
from regents_cosim.errors import CaseError
from regents_cosim.system.files.atomic import explain_write, write_atomic
from regents_cosim.system.files.locks import writing
from regents_cosim.system.files.swap import restore

MANIFEST = "suite.json"
SETTINGS_FILES = ("attack.toml", "record.toml", "suite.toml")  # settings that a command made the suite with
_HEAD_BYTES = 64  # bytes that contain the name of the first field


@dataclass(frozen=True)
class SuiteEntry:
    """The name and the hash of one case of a suite."""

    case: str
    hash: str

    def __post_init__(self) -> None:
        require_file_name(self.case, "case of a suite")


@dataclass(frozen=True)
class Suite:
    """The content of suite.json: the cases of a folder, and how they were made."""

    cases: tuple[SuiteEntry, ...]
    command: str = ""
    seed: int = 0
    versions: dict[str, str] = field(default_factory=dict)
    schema: int = FLAT_SCHEMA
    pending: SuiteEntry | None = None  # a case about to be written; it belongs to the suite if its folder holds it

    def having(self, entry: SuiteEntry) -> "Suite":
        """The suite with `entry` added, replacing an entry of the same name, and nothing pending."""
        entries = {one.case: one for one in (*self.cases, entry)}
        return replace(self, cases=tuple(entries[name] for name in sorted(entries)), pending=None)


def drop_cases(names: Collection[str], suite: Path) -> None:
    """Remove cases from the manifest and from disk; the user's files stay, unknown names are ignored."""
    with explain_write(suite), writing(suite):
        manifest = load_manifest(suite)
        left = tuple(entry for entry in manifest.cases if entry.case not in names)
        if left != manifest.cases:
            save_suite(suite, replace(manifest, cases=left))
        for folder in (inside(suite, name) for name in sorted(names)):
            for path in (folder / name for name in sorted(CASE_FILES)):
                path.unlink(missing_ok=True)
            with suppress(OSError):  # the user's own files are in it, or it is gone
                folder.rmdir()


def is_ours(suite: Path, path: Path) -> bool:
    """Whether the file `path`, relative to a suite, belongs to the suite; all other files are the user's."""
    if len(path.parts) != 2:
        return path == Path(MANIFEST)
    folder, name = path.parent, path.name
    return folder.name == "maps" if is_map_file(name) else is_of_case(suite / folder, Path(name))


def save_suite(folder: Path, suite: Suite) -> None:
    """Write the manifest of a suite."""
    values = msgspec.to_builtins(suite)
    if suite.pending is None:
        del values["pending"]
    with explain_write(folder):
        write_atomic(folder / MANIFEST, in_lines(values))


def has_manifest(folder: Path) -> bool:
    """Whether a folder has a manifest, even a damaged one; a `suite.json` of another tool does not count."""
    path = folder / MANIFEST
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return b'"cases"' in file.read(_HEAD_BYTES)


def load_manifest(folder: Path) -> Suite:
    """Read the manifest of a suite. Raises CaseError where it is missing or cannot be read."""
    restore(folder)
    path = folder / MANIFEST
    if not path.exists():
        raise CaseError(f"no suite.json in {folder} (expected a folder of cases; make one with `regents record`)")
    require_inside(path, folder)
    with explain_read(path, "damaged or truncated"):
        suite = decode(read_bounded(path, JSON_BYTES), Suite, path)
    for case, times in Counter(entry.case for entry in suite.cases).items():
        if times > 1:
            raise CaseError(f"{path} lists case {case!r} {times} times, expected once")
    return _settled(suite, folder)


def _settled(suite: Suite, folder: Path) -> Suite:
    """Resolve the pending case: a killed writer may have stopped before or after it put the case in its place."""
    if suite.pending is None:
        return suite
    try:
        there = load_header(folder / suite.pending.case).hash == suite.pending.hash
    except CaseError:
        there = False
    return suite.having(suite.pending) if there else replace(suite, pending=None)


def _no_cases(named: Path, path: Path) -> str:
    """The message for a path that is not a folder: it may mean a network or a misspelt name."""
    if path.suffix == ".sumocfg":
        return f"{named} is traffic, expected cases: name it with -c"
    if near := nearest(named.name, (*SUITES, *ALL_NETWORKS)):
        return f"{named} is not a folder: did you mean {'' if near[0] in SUITES else '-c '}{names(tuple(near))[0]}?"
    return (
        f"{named} is not a folder (expected a case, a folder of cases, or one that comes with regents_cosim: "
        f"{', '.join(names(SUITES))})"
    )


def suite_of(cases: Path) -> Path:
    """The suite that `cases` is, or that contains this case."""
    return cases.absolute().parent if (cases / HEADER).is_file() else cases


def listed_in(folder: Path) -> tuple[SuiteEntry, ...]:
    """The cases that a folder lists; none where it has no manifest. Raises CaseError for one that cannot be read."""
    return load_manifest(folder).cases if (folder / MANIFEST).exists() else ()


def find_cases(path: Path) -> list[Path]:
    """The case folders that `path` stands for: the case itself, or those that its manifest lists, in order."""
    named, path = path, located(path)
    restore(path)
    if not path.is_dir():
        raise CaseError(_no_cases(named, path))
    if (path / HEADER).is_file():
        return [path]
    return [path / entry.case for entry in load_manifest(path).cases]
