"""`regents shrink`: options in, calls of the package, tables out."""

import dataclasses
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from regents_cosim.cli.options import Cases, OutputOptions, ProgramOptions
from regents_cosim.cli.shared import open_terminal
from regents_cosim.errors import RegentsError


def shrink(
    cases: Cases,
    *,
    output: Annotated[Path | None, Parameter(["--output", "-o"])] = None,
    planner: str | None = None,
    lead: Annotated[float, Parameter(validator=Number(gte=0.0, lte=3600.0))] = 2.0,
    record: Path | None = None,
    act_timeout: float = 10.0,
    programs: ProgramOptions = ProgramOptions(),
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Find the least of a crash: fewest changed agents, least deviation, shortest window.

    Every step is confirmed by the planner, which must still crash in closed loop with the same adversary.

    Parameters
    ----------
    cases
        an attacked case that ends in a collision, or a folder of cases, of which those are taken
    output
        folder for the shrunk cases, NAME-shrunk; by default the suite that holds the case
    planner
        who drives the ego; default the planner that was attacked, if it is one of ours: what a case names is not run
    lead
        the window begins so long before the crash at the latest [s]
    record
        file for a picture of one case before and after: .gif moves, .png is a still
    act_timeout
        a planner outside JAX that takes longer over one decision has failed [s]
    """
    from regents_cosim.cases.files import load_manifest
    from regents_cosim.cases.suite import SuiteWriter, load_suite
    from regents_cosim.evaluation.reduction.shrink import crashes_of, size
    from regents_cosim.evaluation.reduction.shrink import shrink as run_shrink
    from regents_cosim.planners.find import planner_of
    from regents_cosim.planners.under_test import PlannerUnderTest
    from regents_cosim.reports.picture import animate_pair, draw_pair
    from regents_cosim.reports.tables import SHRUNK

    terminal = open_terminal(talk)
    if record and record.suffix not in (".gif", ".png"):
        raise RegentsError(f"--record {record}: expected a name that ends in .gif (moves) or .png (a still)")
    if lead < 0.0:
        raise RegentsError(f"--lead {lead:g}: expected seconds before the crash, 0 or more")
    found = load_suite(cases)
    is_case = (cases / "scenario.json").is_file()
    crashes = found if is_case else crashes_of(found)
    if not crashes:
        raise RegentsError(f"{cases} holds no case that ends in a collision (make some with `regents attack`)")
    if record and len(crashes) > 1:
        raise RegentsError(f"{cases} holds {len(crashes)} crashes; --record shows one, name its folder")
    folder = output or _suite_of(cases, is_case)
    names = [planner_of(case, planner) for case in crashes]
    planners = {name: PlannerUnderTest.of(name) for name in names}
    programs.keep()
    seed = load_manifest(folder).seed if (folder / "suite.json").is_file() else 0
    suite = SuiteWriter(folder, seed)
    rows = []
    for case, name in terminal.each(zip(crashes, names, strict=True), "shrinking", len(crashes)):
        shrunk = run_shrink(case, planners[name], lead_s=lead, act_timeout_s=act_timeout)
        suite.add(shrunk.case)
        rows += [dataclasses.asdict(size(one)) for one in (shrunk.attacked, shrunk.case)]
        if record:
            with terminal.waiting(f"drawing {record}"):
                draw = animate_pair if record.suffix == ".gif" else draw_pair
                draw(shrunk.in_time, shrunk.case, record, titles=("as attacked", "shrunk"))
    terminal.show(f"{len(crashes)} cases before and after, in {folder}", rows, essential=SHRUNK)
    return 0


def _suite_of(cases: Path, is_case: bool) -> Path:
    """Where shrunk cases come to lie by default, beside those that they were. Raises RegentsError for a case alone."""
    suite = cases.resolve().parent if is_case else cases
    if not (suite / "suite.json").is_file():
        raise RegentsError(f"{cases} lies in no suite (expected a folder for the shrunk case: name one with -o)")
    return suite
