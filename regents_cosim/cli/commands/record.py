"""`regents record`: ordinary traffic in, cases out."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from regents_cosim.cli.options import OutputOptions, SumoOptions, TrafficOptions
from regents_cosim.cli.shared import open_terminal, record_traffic


def record(
    *,
    traffic: TrafficOptions = TrafficOptions(),
    output: Annotated[Path, Parameter(["--output", "-o"])],
    executor: str = "local",
    talk: OutputOptions = OutputOptions(),
    sumo: SumoOptions = (),
) -> int:
    """Cut windows of ordinary traffic into cases.

    Parameters
    ----------
    output
        folder for the cases
    executor
        where SUMO runs: local, or dask:ADDRESS
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
