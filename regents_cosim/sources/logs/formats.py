"""The known formats of logs, and which of them a file has.

Other packages add formats through the entry point group `regents_cosim.sources`: each entry is a `LogFormat`.
"""

import os
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from shapely.errors import ShapelyError

from regents_cosim.checks.bounded import PointerError, open_bounded
from regents_cosim.checks.xml_input import unpacked_limit
from regents_cosim.errors import InputError, LogError, RegentsError, ScenarioError
from regents_cosim.plain_text import counted, listed
from regents_cosim.sources.logs.files.csv_columns import header_of
from regents_cosim.sources.logs.files.text import as_utf8
from regents_cosim.sources.logs.headings import require_headings_along_motion
from regents_cosim.sources.logs.roads.road import NO_MAP
from regents_cosim.sources.logs.scene import LoggedScene
from regents_cosim.system.foreign_code import foreign_code, said_by
from regents_cosim.system.user_code import plugins

_HEAD_BYTES = 1 << 16
_LEAST_COLUMNS, _NAMED = 4, 5  # of a table: fewer are none; the most that a message lists

_TABLE = "table"  # the name of the format of any table


@dataclass(frozen=True)
class CompanionFiles:
    """Files that belong to a log but do not lie where its format expects them."""

    road: Path | None = None  # lanelet2 map (.osm)
    columns: Path | None = None  # mapping of a table's columns (.toml)

    def named(self, format: str) -> str:
        """The format in which a log is read: columns are those of a table, unless the format is named."""
        return _TABLE if self.columns is not None and format == "auto" else format


ALONE = CompanionFiles()


@dataclass(frozen=True)
class LogFormat:
    """A format of logs: its name, a description, a function that recognises it and one that reads it.

    `recognises` gets the path and the first 64 KiB (unpacked, text as UTF-8; empty for a folder). `read` yields one
    LoggedScene after the other, and raises LogError or ValueError for what it cannot read.
    """

    name: str
    what: str
    recognises: Callable[[Path, bytes], bool]
    read: Callable[[Path, CompanionFiles], Iterator[LoggedScene]]


@lru_cache(maxsize=1)
def formats() -> dict[str, LogFormat]:
    """All formats by name, those of this package before others. Raises LogError where an entry point is broken.

    Any table is last, which would take many a CSV file of another format for its own.
    """
    from regents_cosim.sources.logs.readers import OWN  # the readers import this module

    *own, table = OWN
    found = {one.name: one for one in own}
    for point in plugins("regents_cosim.sources").values():
        name = f"the log format {point.name!r} ({point.value})"
        with foreign_code(lambda error, name=name: LogError(f"{name} cannot be loaded: {said_by(error)}")):
            one = point.load()
        if not isinstance(one, LogFormat):
            raise LogError(f"{name} is not a LogFormat")
        found.setdefault(point.name, replace(one, name=point.name))
    return {**found, table.name: table}


def find_logs(
    path: Path, name: str = "auto", tell: Callable[[str], None] = warnings.warn
) -> list[tuple[Path, LogFormat]]:
    """The logs at `path`, a file or a folder of logs, sorted by name; `tell` gets a message about those that are not
    there, but a pointer of Git LFS is. `.` and `..` are given by their names, after which scenes are named.

    Raises LogError where there is none, RegentsError for a format that does not exist.
    """
    if name != "auto" and name not in formats():
        raise RegentsError(f"`format` {name}, expected auto or one of {', '.join(formats())}")
    if not path.exists():
        raise LogError(f"log not found: {path} (expected an existing file or folder; check the path)")
    if not path.is_file() and not path.is_dir():
        raise LogError(f"{path} is neither a file nor a folder, expected a log")
    path = path.resolve() if path.name in ("", "..") else path
    found = list(_within(path, name))
    pointers = _pointers(path) if path.is_dir() else ""
    if found:
        if pointers:
            tell(pointers)
        return found
    if path.is_dir():
        raise LogError(f"{pointers or f'{path}: no log in this folder'} (expected {_known()})")
    raise LogError(f"{path}: {_what_it_is(path)}; expected {_known()}")


def format_of(path: Path) -> LogFormat | None:
    """The format that recognises a file or folder, None where none does."""
    head = b"" if path.is_dir() else head_of(path)
    return next((one for one in formats().values() if one.recognises(path, head)), None)


def head_of(path: Path) -> bytes:
    """The first 64 KiB of a file, unpacked if it is gzip, text as UTF-8; of a damaged file as much as can be read."""
    head = b""
    try:
        with open_bounded(path, sys.maxsize) as file:
            while len(head) < _HEAD_BYTES and (piece := file.read1(_HEAD_BYTES - len(head))):
                head += piece
    except InputError as error:
        if not path.is_file() or not os.access(path, os.R_OK):
            raise LogError(f"{error}; expected a log") from error
    return as_utf8(head, "replace")


def unpacked(path: Path) -> bytes:
    """The content of a file, unpacked if it is gzip. Raises LogError where that is damaged or far too large."""
    try:
        with open_bounded(path, unpacked_limit(path)) as file:
            return file.read()
    except InputError as error:
        raise LogError(f"{error}; expected a log") from error


def read_log(path: Path, one: LogFormat, beside: CompanionFiles) -> Iterator[LoggedScene]:
    """The scenes of a log, one at a time. Raises LogError with the file's name where the file is damaged."""
    scenes = one.read(path, beside)
    while True:
        # Absurd numbers may overflow before the checks refuse them.
        with explained(path, one.what), np.errstate(all="ignore"):
            scene = next(scenes, None)
        if scene is None:
            return
        with explained(path, one.what):
            require_headings_along_motion(scene)
        bare = not (scene.road.edges or scene.road.areas)
        yield replace(scene, notes=(*scene.notes, NO_MAP)) if bare else scene


@contextmanager
def explained(path: Path, what: str) -> Iterator[None]:
    """Turn any exception that a reader raises for a damaged file into one LogError."""
    try:
        yield
    except (LogError, InputError, ScenarioError) as error:
        if isinstance(error, LogError) and str(path) in str(error):
            raise
        raise LogError(str(error) if str(path) in str(error) else f"{path}: {error}") from error
    except (
        ValueError, KeyError, IndexError, TypeError, AttributeError, OverflowError, ArithmeticError, ShapelyError
    ) as error:  # fmt: skip
        said = f"{type(error).__name__}: {error}" if isinstance(error, KeyError) else str(error) or type(error).__name__
        raise LogError(f"{path}: damaged, or no {what} ({said[:300]})") from error
    except (OSError, EOFError) as error:
        raise LogError(f"{path}: cannot be read ({error}); expected {what}") from error
    except (MemoryError, RecursionError) as error:
        raise LogError(f"{path}: too large or too deeply nested for {what}") from error


def _within(path: Path, name: str, above: tuple[Path, ...] = ()) -> Iterator[tuple[Path, LogFormat]]:
    here = path.resolve()
    if here in above:  # a link leads back
        return
    one = format_of(path) if name == "auto" else formats()[name]
    if one is not None and (name == "auto" or not path.is_dir() or one.recognises(path, b"")):
        yield path, one
    elif path.is_dir():
        for entry in sorted(path.iterdir()):
            if entry.is_dir() or one is None or one.recognises(entry, head_of(entry)):
                yield from _within(entry, name, (*above, here))


def _pointers(folder: Path) -> str:
    """One line on files in `folder` in whose place there is a pointer of Git LFS; empty where there is none."""
    found = sorted(path for path in folder.rglob("*") if path.is_file() and _is_pointer(path))
    if not found:
        return ""
    return (
        f"{folder}: {counted(len(found), 'pointer')} of Git LFS in place of files, which are left out: "
        f"{found[0].relative_to(folder)}{' ...' * (len(found) > 1)} (fetch with `git lfs pull`)"
    )


def _is_pointer(path: Path) -> bool:
    try:
        open_bounded(path, sys.maxsize).close()
    except InputError as error:
        return isinstance(error, PointerError)
    return False


def _known() -> str:
    return ", ".join(one.what for one in formats().values())


def _what_it_is(path: Path) -> str:
    if path.stat().st_size == 0:
        return "the file is empty"
    try:
        open_bounded(path, sys.maxsize).close()
    except InputError as error:
        return f"this{str(error).removeprefix(str(path))}"
    head = head_of(path)
    if head.startswith(b"PK\x03\x04"):
        return "this is a zip archive (unpack it, and give the folder)"
    if b"<fcd-export" in head:
        return "this is SUMO's fcd-output (give it with --fcd, and its network with -n)"
    columns = header_of(head)
    if len(columns) >= _LEAST_COLUMNS and head.lstrip()[:1] not in b"<{[" and b"\0" not in head:
        return (
            f"this may be a table, of {listed(columns, _NAMED)} (a file {path.name.partition('.')[0]}.toml beside it "
            "says which columns are id, time, x and y: see regents_cosim.sources.logs.readers.table)"
        )
    return "not a log that is known"
