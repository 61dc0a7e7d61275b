"""Shrinks the cases of a folder: which cases, with which planner, and where the shrunk ones are saved."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from regents_cosim.cases.manifest import load_manifest
from regents_cosim.cases.suite import load_suite
from regents_cosim.errors import RegentsError
from regents_cosim.evaluation.reduction.shrink import ShrunkCase, shrink
from regents_cosim.planners.find import planner_of
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.saving import SuiteWriter
from regents_cosim.scenario import Scenario


def crashes_in(cases: Path) -> list[Scenario]:
    """The case at `cases`, or those of a suite that end in a collision. Raises RegentsError for none."""
    found = load_suite(cases)
    if not _is_case(cases):
        found = [case for case in found if case.attack and case.attack.outcome == "collision"]
    if not found:
        raise RegentsError(f"{cases} holds no case that ends in a collision (make some with `regents attack`)")
    return found


def shrink_each(
    crashes: Sequence[Scenario], planner: str | None, *, lead_s: float, act_timeout_s: float = ACT_TIMEOUT_S
) -> Iterator[ShrunkCase]:
    """Shrink each crash with `planner`, or with the planner that was attacked. Unknown planners are reported first."""
    names = [planner_of(case, planner) for case in crashes]
    planners = {name: PlannerUnderTest.of(name) for name in names}
    return (
        shrink(case, planners[name], lead_s=lead_s, act_timeout_s=act_timeout_s, progress=False)
        for case, name in zip(crashes, names, strict=True)
    )


def writer_beside(cases: Path, output: Path | None) -> SuiteWriter:
    """A writer to `output`, or to the suite of the original cases. Raises RegentsError for a case outside a suite."""
    folder = output or (cases.resolve().parent if _is_case(cases) else cases)
    known = (folder / "suite.json").is_file()
    if output is None and not known:
        raise RegentsError(f"{cases} lies in no suite (expected a folder for the shrunk case: name one with -o)")
    return SuiteWriter(folder, load_manifest(folder).seed if known else 0)


def _is_case(folder: Path) -> bool:
    return (folder / "scenario.json").is_file()
