"""Intermediate results of a larger one, recorded windows and attacks, kept in its folder until it is complete."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from regents_cosim.cases.files import load_case
from regents_cosim.checks.names import distinct_word, inside
from regents_cosim.runs.attack_run import attack_left, attacked_headers
from regents_cosim.runs.identity import identity
from regents_cosim.runs.ledger import FOLDER, STEPS, is_written, open_ledger, redo_lost
from regents_cosim.runs.window_job import AttackRun
from regents_cosim.runs.windows import planned, record_once, windows_of
from regents_cosim.saving import SuiteWriter
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.system.files.atomic import remove_written
from regents_cosim.system.progress import SILENT, Progress

_NAME = 60  # most characters


@dataclass(frozen=True)
class Steps:
    """The intermediate results in one folder."""

    folder: Path

    def recorded(
        self, name: str, settings: dict[str, Any], traffic: str, record: Callable[[], Sequence[Scenario]]
    ) -> list[Scenario]:
        """Recorded windows; `traffic` is a digest of its files. Raises CaseError where settings have changed."""
        place = self._place(name)
        names = record_once(place, identity("record", settings, {}), traffic, 0, record)
        return [load_case(place / one) for one in names]

    def attacked(
        self, name: str, windows: Sequence[Scenario], run: AttackRun, progress: Progress = SILENT
    ) -> list[list[Scenario]]:
        """The cases that an attack finds in each window. Raises CaseError where settings have changed."""
        place, together = self._place(name), run.together()
        with open_ledger(place, run.identity({}, together), together=together) as ledger:
            redo_lost(ledger)
            held = windows_of(windows)
            planned(ledger, held)
            attack_left(ledger, held, run, SuiteWriter(place, 0), progress=progress)
            ledger.finish()
            headers, _ = attacked_headers(ledger.record, place)
        found: dict[str, list[Scenario]] = {window.id: [] for window in windows}
        for header in headers:
            assert header.attack is not None
            found[header.attack.case].append(load_case(place / header.id))
        return list(found.values())

    def clear(self) -> None:
        """Remove the intermediate results, once the larger one is complete."""
        remove_written(self.folder / FOLDER, is_written)

    def _place(self, name: str) -> Path:
        return inside(self.folder, FOLDER, STEPS, distinct_word(name, _NAME))
