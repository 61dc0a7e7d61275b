"""Add crashes to a growing suite: those in empty cells of the map of behaviours, and those better than the best.

A crash is new if its cell is empty, or if it is plainer or gentler than the best one there. Cases in the suite stay, as
their outcome may have been accepted. Every case is added whole or not at all, and a known case is not added again; so a
run after a kill adds only what is missing.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from regents_cosim.archive.axes import Cell
from regents_cosim.archive.crash import Crash, crash_of
from regents_cosim.archive.elites import Archive
from regents_cosim.campaign.window_job import Still
from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import STILL, load_header
from regents_cosim.cases.header import HEADER
from regents_cosim.cases.manifest import load_manifest
from regents_cosim.replays.replay import replay_each
from regents_cosim.saving import add_case
from regents_cosim.scenario import Scenario
from regents_cosim.system.atomic import write_atomic
from regents_cosim.system.interruption import keep, made_whole

_HASH = 8  # digits of the hash behind a name that is taken


@dataclass(frozen=True)
class AddedCrash:
    """A crash that was added to the suite."""

    crash: Crash
    cell: Cell
    why: str  # "new cell", "plainer" or "gentler"
    than: str  # name of the former best case of its cell; empty for a new cell


@dataclass(frozen=True)
class SuiteIntake:
    """A suite with the requirements for crashes that it takes in."""

    folder: Path
    archive: Archive  # of the crashes in the suite
    still: Still | None  # draws the picture of a case; None: cases have no pictures
    verify: bool = True  # whether SUMO has to confirm a crash
    # saves an added case in a second place, and returns its folder there
    copy: Callable[[Scenario], Path] | None = None

    def take(self, crashes: Sequence[Scenario]) -> list[AddedCrash]:
        """Add those of the crashes that are new, and return them."""
        new = [case for case in crashes if (crash := crash_of(case)) and self.archive.improves(crash)]
        if self.verify and new:
            confirmed = {one.case for one in replay_each(new, "sumo") if one.verified}
            new = [case for case in new if case.id in confirmed]
        return [added for case in new if (added := self._add(case))]

    def _add(self, case: Scenario) -> AddedCrash | None:
        """Add a crash, unless an earlier one of the same list has just filled its cell with a better one."""
        case = self._with_free_name(case)
        crash = crash_of(case)
        why = self.archive.improves(crash) if crash else ""
        if crash is None or not why:
            return None
        best = self.archive.elite(self.archive.axes.cell(crash))
        with made_whole():
            folder = add_case(case, self.folder, replace(load_manifest(self.folder), cases=()))
            added = AddedCrash(crash, self.archive.add(crash), why, best.case if best else "")
        keep(f"cases that are new are added to {self.folder}")
        places = [folder, *([self.copy(case)] if self.copy else [])]
        for place in places if self.still else []:
            assert self.still is not None
            write_atomic(place / STILL, self.still(case))
        return added

    def _with_free_name(self, case: Scenario) -> Scenario:
        """The case, renamed with its hash if the suite has another case of that name."""
        digest = content_hash(case)
        there = self.folder / case.id
        if not (there / HEADER).is_file() or load_header(there).hash == digest:
            return case
        return replace(case, id=f"{case.id}-{digest[:_HASH]}")
