"""`regents report`: one page of all cases."""

from regents_cosim.cli.options import ActTimeout, Cases, Output, OutputOptions, ProgramOptions
from regents_cosim.cli.shared import open_terminal
from regents_cosim.errors import PLANNER_FAILED
from regents_cosim.planners.patience import ACT_TIMEOUT_S


def report(
    cases: Cases,
    *,
    output: Output,
    planner: tuple[str, ...] = (),
    act_timeout: ActTimeout = ACT_TIMEOUT_S,
    programs: ProgramOptions = ProgramOptions(),
    talk: OutputOptions = OutputOptions(),
) -> int:
    """One HTML file with the scores, every case in a player, and what is known of it; opens anywhere, offline.

    Parameters
    ----------
    cases
        a case or a folder of cases; shipped:standard, shipped:quickstart and shipped:on_foot come with the package
    output
        file for the page (.html); the scores and the table go into NAME.report.json beside it
    planner
        who drives the egos, among the adversaries of each case; once more: a second one beside it, to see what it fixes
        and breaks. Without it the report shows the drives that the cases hold
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
    programs.keep()
    given = [PlannerUnderTest.of(name) for name in planner]
    judged, driven = judged_and_driven(scenarios, given, act_timeout)
    what = f"driving {' and '.join(planner)}" if planner else "packing"
    made = report_of(judged, driven, cases, tags, lambda done: terminal.each(done, what, len(scenarios)))
    with terminal.waiting(f"writing {output}"):
        save_report(made, output)
    rows = [{"score": s.label, "driver": s.driver, "value": s.value, "detail": s.detail} for s in made.scores]
    terminal.show(f"{len(scenarios)} cases in {output}", rows, "\n".join(made.crash_lines), SCORED)
    errors = [(case.id, run) for case in made.cases for run in case.runs if run.error]
    for name, run in errors:
        terminal.say(f"{name}: {run.driver}: {run.error}")
    return PLANNER_FAILED if errors else 0
