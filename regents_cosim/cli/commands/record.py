"""`regents record`: ordinary traffic in, cases out."""

from regents_cosim.cli.options import Executor, Output, OutputOptions, SumoOptions, TrafficOptions
from regents_cosim.cli.shared import open_terminal, record_traffic


def record(
    *,
    traffic: TrafficOptions = TrafficOptions(),
    output: Output,
    executor: Executor = "local",
    talk: OutputOptions = OutputOptions(),
    sumo: SumoOptions = (),
) -> int:
    """Cut windows of ordinary traffic into cases.

    Parameters
    ----------
    output
        folder for the cases
    """
    from regents_cosim.cases.suite import SuiteWriter
    from regents_cosim.reports.tables import RECORDED, case_row

    terminal = open_terminal(talk)
    suite = SuiteWriter(output, traffic.seed)
    scenarios = record_traffic(traffic, sumo, executor, terminal)
    for scenario in scenarios:
        suite.add(scenario)
    terminal.show(
        f"{len(scenarios)} cases in {output}",
        [case_row(scenario) for scenario in scenarios],
        essential=RECORDED,
    )
    return 0
