"""Which windows have been attacked for a suite that grows: `SUITE/explored.json`, so that the next session goes on."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import msgspec

from regents_cosim.cases.json_files import JSON_BYTES, SCHEMA
from regents_cosim.checks.bounded import read_bounded
from regents_cosim.checks.names import require_inside
from regents_cosim.errors import CaseError
from regents_cosim.scenario import Scenario
from regents_cosim.system.atomic import explain_write, write_atomic
from regents_cosim.tags.table import TAGS, tags_of

EXPLORED = "explored.json"
_AROUND = tuple(name for name, tag in TAGS.items() if tag.about in ("ego", "place", "lights", "density"))


class Explored(msgspec.Struct):
    """What one run has attacked: one planner as it is, by one method."""

    planner: str
    method: str
    rounds: dict[str, int] = {}  # of traffic, by what it is recorded from: how many are done
    windows: dict[str, str] = {}  # by what identifies one: what there is around its ego


class _File(msgspec.Struct):
    schema: int = 1
    runs: dict[str, Explored] = {}


@dataclass(frozen=True)
class ExploredFile:
    """That file, for one run."""

    suite: Path
    key: str
    content: _File

    @property
    def run(self) -> Explored:
        """What this run has attacked."""
        return self.content.runs[self.key]

    def counts(self) -> Counter[str]:
        """How many windows of each kind it has attacked."""
        return Counter(self.run.windows.values())

    def note(self, window: str, kind: str) -> None:
        """A window is done."""
        self.run.windows[window] = kind
        self.save()

    def end_round(self, traffic: str, number: int) -> None:
        """So many rounds of that traffic are done."""
        self.run.rounds[traffic] = number
        self.save()

    def save(self) -> None:
        """Write the file, as a whole or not at all."""
        with explain_write(self.suite):
            text = msgspec.json.encode(self.content, order="deterministic")
            write_atomic(self.suite / EXPLORED, msgspec.json.format(text, indent=1) + b"\n")


def open_explored(suite: Path, key: str, planner: str, method: str) -> ExploredFile:
    """The file of a suite, for the run of that key; of a planner as it was before nothing is kept. Raises CaseError."""
    path = require_inside(suite / EXPLORED, suite)
    try:
        content = msgspec.json.decode(read_bounded(path, JSON_BYTES), type=_File) if path.exists() else _File()
    except msgspec.MsgspecError as error:
        raise CaseError(f"{path}: {error} (remove it to explore from the beginning)") from error
    if content.schema > SCHEMA:
        raise CaseError(f"{path}: schema {content.schema}, this version reads up to {SCHEMA} (upgrade regents_cosim)")
    runs = {of: run for of, run in content.runs.items() if of == key or (run.planner, run.method) != (planner, method)}
    return ExploredFile(suite, key, _File(runs={**runs, key: runs.get(key) or Explored(planner, method)}))


def kind_of(window: Scenario) -> str:
    """What there is around the ego of a window: what it does, where, whether there are lights, how dense it is."""
    return kind_by_tags(tags_of(window))


def kind_by_tags(tags: tuple[str, ...]) -> str:
    """The same of one whose tags are known."""
    return ", ".join(tag for tag in _AROUND if tag in tags)
