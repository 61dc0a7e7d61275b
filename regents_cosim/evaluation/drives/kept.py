"""Saves drives as they are made, so that an evaluation can be continued."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import msgspec

from regents_cosim.errors import RegentsError
from regents_cosim.evaluation.drives.driving import DriveResult
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.runs.identity import identity
from regents_cosim.runs.ledger import DoneUnit, open_ledger
from regents_cosim.runs.planner_files import planner_digest
from regents_cosim.runs.windows import planned, windows_of
from regents_cosim.scenario import Scenario


def drive_once(
    folder: Path,
    scenarios: Sequence[Scenario],
    planner: PlannerUnderTest,
    settings: dict[str, str | float],
    drive: Callable[[Iterable[Scenario]], Iterator[DriveResult]],
    retry: bool = False,
) -> Iterator[DriveResult]:
    """The drives of all scenarios, in order; those that are missing in `folder` are made by `drive`.

    A saved drive is valid for a case, a planner's files, this version and these `settings`. With `retry` failed ones
    are repeated. Raises CaseError for a folder of other settings, RegentsError for a planner without a name.
    """
    if planner.source != planner.name:
        raise RegentsError("only drives of planners given by name can be kept: a change of an object cannot be seen")
    mine = identity("evaluate", {"planner": planner.name, **settings}, {planner.name: planner_digest(planner.name)})
    with open_ledger(folder, mine) as ledger:
        windows = windows_of(scenarios)
        planned(ledger, windows)
        left = {unit.name: unit for unit in ledger.left(retry)}
        new = drive(windows.load(left))
        for name in windows.hashes:
            if name in left:
                made = next(new)
                why = made.error.partition("\n")[0]
                ledger.note(DoneUnit(left[name], said=msgspec.to_builtins(made), error=why))
            yield msgspec.convert(ledger.record.done[name].said, DriveResult)
        ledger.finish()
