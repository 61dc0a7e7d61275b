"""`regents record`: cuts ordinary traffic into cases."""

from regents_cosim.cli.options import (
    AskedFor,
    Executor,
    Output,
    OutputOptions,
    SettingsFile,
    SumoOptions,
    TrafficOptions,
)
from regents_cosim.cli.shared import given_traffic, open_terminal
from regents_cosim.plain_text import counted


def record(
    *,
    traffic: TrafficOptions = TrafficOptions(),
    output: Output,
    executor: Executor = "local",
    settings: SettingsFile = None,
    talk: OutputOptions = OutputOptions(),
    sumo: SumoOptions = (),
    asked: AskedFor,
) -> int:
    """Cut windows of ordinary traffic into cases.

    The same command into the same folder records nothing twice.

    Parameters
    ----------
    output
        folder for the cases
    """
    from regents_cosim.cases.files import load_case
    from regents_cosim.reports.tables import RECORDED, case_row
    from regents_cosim.runs.folders import record_into

    terminal = open_terminal(talk)
    names = record_into(output, given_traffic(traffic, sumo), executor=executor, progress=terminal)
    asked.keep(output)
    rows = [case_row(load_case(output / name)) for name in names]
    terminal.show(f"{counted(len(rows), 'case')} in {output}", rows, essential=RECORDED)
    terminal.suggest(("regents", "attack", output, "--planner", "idm", "-o", "attacked"))
    return 0
