"""Checks the files that SUMO opens by itself: their size, the files that they name, and what they would write.

SUMO unpacks its files into memory, and any of them may include others. So each is first read to its end here, within
the bounds of `checks.xml_input`. Many elements also write: detectors, lights, probes, vehicles with a device. If a file
contains anything that is not known to write nothing (`words`), SUMO gets a copy without it. Detectors and vehicles
stay, since traffic may depend on them; their output is discarded.
"""

import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import escape, quoteattr

from regents_cosim.checks.bounded import open_bounded
from regents_cosim.checks.xml_input import explained_xml, unpacked_limit, walk
from regents_cosim.errors import RegentsError, SumoError, require_file
from regents_cosim.maps.net_elements import names_a_file
from regents_cosim.simulators.sumo.words import ATTRIBUTES, ELEMENTS, NOWHERE, READ, READ_BY, WRITTEN

_WHAT = "a file of a SUMO simulation"
_MOST_READERS = 100  # most signs and rerouters that share one file
_HEAD_BYTES = 256
_CONTAINERS = frozenset({"container", "containerFlow"})
_UNKNOWN = "unknown"  # an element that SUMO ignores together with its content
_ENCODINGS = (None, "utf-8", "us-ascii", "iso-8859-1")  # encodings that every XML reader interprets alike
_WRITES_NOWHERE = (NOWHERE, NOWHERE.lower(), os.devnull)


@dataclass(frozen=True)
class FileContents:
    """What a file includes, reads and writes."""

    included: Mapping[Path, int]  # files, and how often each is included
    read: Mapping[Path, int]  # files that elements name, and how often
    taken: Mapping[str, int]  # elements and attributes that would write, and how often each occurs
    as_it_is: bool  # whether SUMO may read the file itself, because it contains nothing that is unknown or writes
    containers: bool  # whether it brings containers, which TraCI does not show
    limits: bool  # whether signs or calibrators in it change speed limits while SUMO runs


Survey = Mapping[Path, FileContents]


def survey(files: Iterable[Path]) -> Survey:
    """The contents of these files and of all that they name. Raises SumoError where one would exhaust SUMO's memory."""
    found: dict[Path, FileContents] = {}
    seen: set[Path] = set()
    for path in files:
        _follow(_key(path), seen, found)
    return found


def _key(path: Path) -> Path:
    """A canonical path: the folder is resolved, but not the file, since relative names start from the folder."""
    return path.parent.resolve() / path.name


def _follow(path: Path, seen: set[Path], found: dict[Path, FileContents]) -> None:
    """Add a file and all files that it names to `found`. Raises SumoError where a file is included twice."""
    waiting = [path]
    while waiting:
        path = waiting.pop()
        if path in found:
            continue
        seen.add(path.resolve())
        found[path] = contents = _contents(path)
        for one, times in contents.included.items():
            if times > 1 or one.resolve() in seen:
                raise SumoError(f"{path} includes {one}, which is included already (expected each file once)")
        for one, times in contents.read.items():
            if times > _MOST_READERS:
                raise SumoError(f"{path} names {one} {times} times, expected at most {_MOST_READERS}")
        waiting += [*contents.included, *(one for one in contents.read if one not in found and is_xml(one))]


def _contents(path: Path) -> FileContents:
    with explained_xml(path, _WHAT, SumoError):
        about = require_file(path, _WHAT).stat()
    return _read(path, about.st_mtime_ns, about.st_size, about.st_ino)


@lru_cache(maxsize=1024)
def _read(path: Path, *_as_it_was: int) -> FileContents:
    """The contents of a file. The further arguments make the cache miss when the file changes."""
    included, read, taken = Counter[Path](), Counter[Path](), Counter[str]()
    encodings: list[str | None] = []
    root = as_it_is = True
    containers = limits = False

    def visit(tag: str, attributes: dict[str, str]) -> None:
        nonlocal root, as_it_is, containers, limits
        at_root, root = root, False
        containers |= tag in _CONTAINERS
        limits |= tag == "variableSpeedSign" or (tag == "flow" and "speed" in attributes)  # that of a calibrator
        if tag in ELEMENTS and attributes.keys() <= ATTRIBUTES and not _is_output(tag, attributes):
            return  # true for most elements
        if tag == "include":
            included.update(map(_key, existing(path.parent / attributes.get("href", ""))))
        elif tag in READ_BY and attributes.get("file"):
            read.update(map(_key, existing(path.parent / attributes["file"])))
        if not at_root or tag in ELEMENTS:
            shown = _shown(tag, attributes, path.parent)
            taken.update(shown.taken)
            as_it_is &= shown.as_it_is

    walk(path, _WHAT, SumoError, visit, encoded=encodings.append)
    plain = all(encoding is None or encoding.lower() in _ENCODINGS for encoding in encodings)
    return FileContents(dict(included), dict(read), dict(taken), plain and as_it_is, containers, limits)


class _ShownElement(NamedTuple):
    """An element in the form in which SUMO may read it."""

    tag: str
    attributes: dict[str, str]  # with absolute paths of files
    as_it_is: bool
    taken: tuple[str, ...] = ()  # attributes that would make SUMO write


def _shown(
    tag: str, attributes: dict[str, str], folder: Path, shown: Callable[[Path], Path] = lambda path: path
) -> _ShownElement:
    if tag not in ELEMENTS:
        return _ShownElement(_UNKNOWN, {}, False)
    if _is_output(tag, attributes):
        return _ShownElement(_UNKNOWN, {}, False, (f"the parameter {attributes['key']}",))
    kept, taken = dict[str, str](), list[str]()
    for name, value in attributes.items():
        if name in ATTRIBUTES or name.startswith(("xml", "xsi:")):
            kept[name] = value
        elif name in READ or (name == "file" and tag in READ_BY):
            kept[name] = str(shown(folder / value)) if value else value
        elif name == "file" or name in WRITTEN:
            kept[name] = NOWHERE
            if value not in _WRITES_NOWHERE:
                taken.append(f"{name} of <{tag}>")
    return _ShownElement(tag, kept, kept.keys() == attributes.keys() and not taken, tuple(taken))


def _is_output(tag: str, attributes: dict[str, str]) -> bool:
    return tag == "param" and names_a_file(attributes.get("key", ""))


class ShownFiles:
    """The files that SUMO reads: originals, or copies in a folder where the original would write."""

    def __init__(self, files: Survey, folder: Path) -> None:
        self._folder = folder
        self._shown: dict[Path, Path] = {}
        self._differ = _that_differ(files)

    def of(self, path: Path) -> Path:
        """The file that SUMO is to read in place of `path`."""
        key = _key(path)
        if key not in self._differ:
            return path
        if key not in self._shown:
            copy = self._shown[key] = self._folder / f"{len(self._shown)}-{path.name.removesuffix('.gz')}"
            self._write(path, copy)
        return self._shown[key]

    def _write(self, path: Path, copy: Path) -> None:
        with copy.open("w", encoding="utf-8") as file:
            begun: list[str] = []

            def begin(tag: str, attributes: dict[str, str]) -> None:
                shown = _shown(tag, attributes, path.parent, self.of)
                begun.append(shown.tag)
                named = "".join(f" {key}={quoteattr(value)}" for key, value in shown.attributes.items())
                file.write(f"<{shown.tag}{named}>")

            walk(path, _WHAT, SumoError, begin, lambda _: file.write(f"</{begun.pop()}>"),
                 lambda text: file.write(escape(text)))  # fmt: skip


def _that_differ(files: Survey) -> set[Path]:
    """The files of which SUMO gets a copy: those that would write, and all that refer to one."""
    differ = {path for path, one in files.items() if not one.as_it_is}
    while True:
        more = {path for path, one in files.items() if not differ.isdisjoint([*one.included, *one.read])} - differ
        if not more:
            return differ
        differ |= more


def exists(path: Path) -> bool:
    """Whether something other than a folder lies there; False for an invalid name."""
    try:
        return path.exists() and not path.is_dir()
    except (OSError, ValueError):
        return False


def existing(path: Path) -> list[Path]:
    """[`path`] if something other than a folder lies there, else an empty list."""
    return [path] if exists(path) else []


def is_xml(path: Path) -> bool:
    """Whether SUMO may read a file as XML, judged by its name: scripts, tables and pictures are not XML."""
    try:
        require_file(path, "file of a SUMO simulation")
        with open_bounded(path, unpacked_limit(path)) as file:
            return b"<" in file.read(_HEAD_BYTES)
    except RegentsError as error:
        raise SumoError(f"{error}; expected a file of a SUMO simulation") from error
