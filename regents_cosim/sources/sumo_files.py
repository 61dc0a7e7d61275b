"""The files that SUMO opens by itself: how large they are, and those that they name in turn.

SUMO unpacks what it is given and keeps it in memory, and any of its files may include others. So each is read to its
end here first, within the bounds of `xml_count`.
"""

import os
import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from regents_cosim.checks.bounded import open_bounded
from regents_cosim.errors import RegentsError, SumoError, require_file
from regents_cosim.sources.xml_input import unpacked_limit, walk

# The attribute with which an element names a file that SUMO writes.
OUTPUT_ATTRIBUTES = {
    **dict.fromkeys(
        ("e1Detector", "inductionLoop", "e2Detector", "laneAreaDetector", "e3Detector", "entryExitDetector",
         "instantInductionLoop", "edgeData", "laneData", "routeProbe", "vTypeProbe"),
        "file",
    ),
    "timedEvent": "dest",
    "calibrator": "output",
}  # fmt: skip
_MOST_READERS = 100  # signs and rerouters that share one file
_HEAD_BYTES = 256


def require_bounded(traffic: Iterable[Path], values: Iterable[str]) -> None:
    """Raise SumoError where a file of the traffic, or one that an option's value names, would fill SUMO's memory."""
    seen: set[Path] = set()
    named = [path for value in values for path in _named_in(value) if _is_xml(path)]
    for path in [*traffic, *named]:
        if path.resolve() not in seen:
            _follow(path, seen)


def _follow(path: Path, seen: set[Path]) -> None:
    """A file, and those that it names; one that includes itself would never end."""
    waiting = [path]
    while waiting:
        path = waiting.pop()
        seen.add(path.resolve())
        included, shared = _named_by(path)
        for one, times in included.items():
            if times > 1 or one.resolve() in seen:
                raise SumoError(f"{path} includes {one}, which is included already (expected each file once)")
        for one, times in shared.items():
            if times > _MOST_READERS:
                raise SumoError(f"{path} names {one} {times} times, expected at most {_MOST_READERS}")
        waiting += [*included, *(one for one in shared if one.resolve() not in seen and _is_xml(one))]


def _named_by(path: Path) -> tuple[Counter[Path], Counter[Path]]:
    """The files that a file includes, and those that elements of it read."""
    included: Counter[Path] = Counter()
    shared: Counter[Path] = Counter()

    def visit(tag: str, attributes: dict[str, str]) -> None:
        if tag == "include":
            included.update(_existing(path.parent, attributes.get("href", "")))
        elif "file" in attributes and OUTPUT_ATTRIBUTES.get(tag) != "file":
            shared.update(_existing(path.parent, attributes["file"]))

    walk(path, "a file of a SUMO simulation", SumoError, visit)
    return included, shared


def _named_in(value: str) -> set[Path]:
    parts = {value, *re.split("[,;]", value), *value.split()}
    return {one for part in parts for one in _existing(Path(), part.strip())}


def exists(path: Path) -> bool:
    """Whether something other than a folder lies there; no for what cannot be a name."""
    try:
        return path.exists() and not path.is_dir()
    except (OSError, ValueError):
        return False


def _existing(folder: Path, name: str) -> list[Path]:
    path = folder / os.path.expandvars(name)
    return [path] if exists(path) else []


def _is_xml(path: Path) -> bool:
    """Whether SUMO may take a file for XML: not so a script, a table or a picture."""
    try:
        require_file(path, "file of a SUMO simulation")
        with open_bounded(path, unpacked_limit(path)) as file:
            return b"<" in file.read(_HEAD_BYTES)
    except RegentsError as error:
        raise SumoError(f"{error}; expected a file of a SUMO simulation") from error
