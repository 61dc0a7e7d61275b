"""`regents report`: writes one page about all cases."""

from regents_cosim.cli.options import ActTimeout, Cases, Output, OutputOptions
from regents_cosim.cli.shared import open_terminal
from regents_cosim.errors import PLANNER_FAILED
from regents_cosim.plain_text import all_named, counted
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S


def report(
    cases: Cases,
    *,
    output: Output,
    planner: tuple[str, ...] = (),
    act_timeout: ActTimeout = ACT_TIMEOUT_S,
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Write one HTML file with the scores and every case in a player; it works offline.

    Parameters
    ----------
    output
        file for the page (.html); the scores and the table are saved as NAME.report.json beside it
    planner
        planner that drives the ego among the adversaries of each case; repeat the option to compare a second planner
        with the first. By default the report shows the drives that are saved in the cases
    """
    from regents_cosim.cases.suite import cases_on_disk
    from regents_cosim.planners.under_test import PlannerUnderTest
    from regents_cosim.reports.report import check_report, judged_and_driven, report_of, save_report
    from regents_cosim.reports.tables import SCORED

    terminal = open_terminal(talk)
    check_report(output, planner)
    with terminal.waiting("reading"):
        scenarios = cases_on_disk(cases)
        tags = {one.id: one.tags for one in scenarios.headers() if one.tags is not None}
    given = [PlannerUnderTest.of(name) for name in planner]
    judged, driven = judged_and_driven(scenarios, given, act_timeout)
    what = f"driving {all_named(planner)}" if planner else "packing"
    made = report_of(judged, driven, cases, tags, lambda done: terminal.each(done, what, len(scenarios)))
    with terminal.waiting(f"writing {output}"):
        save_report(made, output)
    rows = [{"score": s.label, "driver": s.driver, "value": s.value, "detail": s.detail} for s in made.scores]
    terminal.show(f"{counted(len(scenarios), 'case')} in {output}", rows, "\n".join(made.crash_lines), SCORED)
    errors = [(case.id, run) for case in made.cases for run in case.runs if run.error]
    for name, run in errors:
        terminal.say(f"{name}: {run.driver}: {run.error}")
    return PLANNER_FAILED if errors else 0
