"""`regents shrink`: reduces crashes to their smallest form."""

import dataclasses
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from regents_cosim.cli.options import ActTimeout, Cases, OutputIfAny, OutputOptions, PlannerOfCase
from regents_cosim.cli.shared import open_terminal, require_picture_name
from regents_cosim.errors import RegentsError
from regents_cosim.plain_text import counted
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S


def shrink(
    cases: Cases,
    *,
    output: OutputIfAny = None,
    planner: PlannerOfCase = None,
    lead: Annotated[float, Parameter(validator=Number(gte=0.0, lte=3600.0))] = 2.0,
    record: Path | None = None,
    act_timeout: ActTimeout = ACT_TIMEOUT_S,
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Reduce a crash: fewest changed agents, least deviation, shortest window.

    The planner confirms every step: it must still crash in closed loop with the same adversary.

    Parameters
    ----------
    cases
        an attacked case that ends in a collision, or a folder of cases, of which the others are skipped
    output
        folder for the reduced cases, NAME-shrunk; by default the suite that holds the case
    lead
        least time from the begin of the window to the crash [s]
    record
        file for a picture of one case before and after: .gif is animated, .png is a still
    """
    from regents_cosim.evaluation.reduction.shrink import crashes_in, shrink_each, size, writer_beside
    from regents_cosim.reports.picture import animate_pair, draw_pair
    from regents_cosim.reports.tables import SHRUNK

    terminal = open_terminal(talk)
    require_picture_name(record)
    crashes = crashes_in(cases)
    if record and len(crashes) > 1:
        raise RegentsError(f"{cases} holds {len(crashes)} crashes; --record shows one, name its folder")
    made = shrink_each(crashes, planner, lead_s=lead, act_timeout_s=act_timeout)
    suite = writer_beside(cases, output)
    rows = []
    for shrunk in terminal.each(made, "shrinking", len(crashes)):
        suite.add(shrunk.case)
        rows += [dataclasses.asdict(size(one)) for one in (shrunk.attacked, shrunk.case)]
        if record:
            with terminal.waiting(f"drawing {record}"):
                draw = animate_pair if record.suffix == ".gif" else draw_pair
                draw(shrunk.in_time, shrunk.case, record, titles=("as attacked", "shrunk"))
    terminal.show(f"{counted(len(crashes), 'case')} before and after, in {suite.folder}", rows, essential=SHRUNK)
    return 0
