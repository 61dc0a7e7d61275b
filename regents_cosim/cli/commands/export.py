"""`regents export`: writes a case in the format of another tool."""

from typing import Literal

from regents_cosim.cli.options import CasePath, Output, OutputOptions
from regents_cosim.cli.shared import open_terminal
from regents_cosim.errors import RegentsError


def export(
    case: CasePath,
    *,
    to: Literal["fcd", "csv", "openscenario", "commonroad"],
    output: Output,
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Write a case in the format of another tool.

    Parameters
    ----------
    case
        a case: its folder, or shipped:SUITE/CASE
    to
        fcd: SUMO's fcd-output with network and configuration, which plain sumo-gui opens; csv: a table of tracks;
        openscenario: OpenSCENARIO 1.2 and OpenDRIVE; commonroad: CommonRoad 2020a
    output
        new folder for the files
    """
    from regents_cosim.cases.suite import load_suite
    from regents_cosim.exports.export import export as run_export

    terminal = open_terminal(talk)
    scenarios = load_suite(case)
    if len(scenarios) > 1:
        raise RegentsError(f"{case} holds {len(scenarios)} cases; export takes one, name its folder")
    with terminal.waiting(f"writing {output}"):
        files = run_export(scenarios[0], to, output, tell=terminal.say)
    rows = [{"file": file.name, "bytes": file.stat().st_size} for file in files]
    terminal.show(f"{scenarios[0].id} as {to} in {output}", rows)
    return 0
