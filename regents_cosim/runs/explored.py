"""The file `SUITE/explored.json`: windows that were attacked for a growing suite, so that the next run continues."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import msgspec

from regents_cosim.cases.json_files import JSON_BYTES, SCHEMA
from regents_cosim.checks.bounded import read_bounded
from regents_cosim.checks.names import require_inside
from regents_cosim.errors import CaseError
from regents_cosim.scenario import Scenario
from regents_cosim.system.files.atomic import explain_write, write_atomic
from regents_cosim.tags.table import TAGS, tags_of

EXPLORED = "explored.json"
_AROUND = tuple(name for name, tag in TAGS.items() if tag.about in ("ego", "place", "lights", "density"))


class ExploredWindows(msgspec.Struct):
    """The windows that one planner was attacked in by one method."""

    planner: str
    method: str
    rounds: dict[str, int] = {}  # number of finished rounds of recording, by the traffic that is recorded
    windows: dict[str, str] = {}  # the surroundings of the ego, by the hash of the window


class _File(msgspec.Struct):
    schema: int = 1
    runs: dict[str, ExploredWindows] = {}


@dataclass(frozen=True)
class ExploredFile:
    """The file explored.json of a suite, for one run."""

    suite: Path
    key: str
    content: _File

    @property
    def run(self) -> ExploredWindows:
        """The record of this run."""
        return self.content.runs[self.key]

    def counts(self) -> Counter[str]:
        """The number of attacked windows by kind of surroundings."""
        return Counter(self.run.windows.values())

    def note(self, window: str, kind: str) -> None:
        """Note a finished window, and write the file."""
        self.run.windows[window] = kind
        self.save()

    def end_round(self, traffic: str, number: int) -> None:
        """Note how many rounds of some traffic are finished, and write the file."""
        self.run.rounds[traffic] = number
        self.save()

    def save(self) -> None:
        """Write the file atomically."""
        with explain_write(self.suite):
            text = msgspec.json.encode(self.content, order="deterministic")
            write_atomic(self.suite / EXPLORED, msgspec.json.format(text, indent=1) + b"\n")


def open_explored(suite: Path, key: str, planner: str, method: str) -> ExploredFile:
    """Open a suite's file for the run `key`; other versions of the planner are dropped. Raises CaseError."""
    path = require_inside(suite / EXPLORED, suite)
    try:
        content = msgspec.json.decode(read_bounded(path, JSON_BYTES), type=_File) if path.exists() else _File()
    except msgspec.MsgspecError as error:
        raise CaseError(f"{path}: {error} (remove it to explore from the beginning)") from error
    if content.schema > SCHEMA:
        raise CaseError(f"{path}: schema {content.schema}, this version reads up to {SCHEMA} (upgrade regents_cosim)")
    runs = {of: run for of, run in content.runs.items() if of == key or (run.planner, run.method) != (planner, method)}
    return ExploredFile(suite, key, _File(runs={**runs, key: runs.get(key) or ExploredWindows(planner, method)}))


def kind_of(window: Scenario) -> str:
    """The surroundings of the ego of a window in words: what the ego does, place, lights and density."""
    return kind_by_tags(tags_of(window))


def kind_by_tags(tags: tuple[str, ...]) -> str:
    """The surroundings in words, as `kind_of`, from known tags."""
    return ", ".join(tag for tag in _AROUND if tag in tags)
