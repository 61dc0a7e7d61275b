"""`regents status`: shows the progress of a run."""

import dataclasses
from pathlib import Path

from regents_cosim.cli.options import OutputOptions
from regents_cosim.cli.shared import open_terminal

_SHOWN = 10  # most failures shown


def status(folder: Path, *, talk: OutputOptions = OutputOptions()) -> int:
    """Show the progress of a run: what is done, failed and left, how fast it is, and how long it will still take.

    Parameters
    ----------
    folder
        output folder (-o) of `regents record`, `attack`, `evaluate`, `suite build` or `bench table1`
    """
    from regents_cosim.reports.tables import STATUS, status_row
    from regents_cosim.runs.status import runs_in

    terminal = open_terminal(talk)
    found = runs_in(folder)
    if talk.json:
        terminal.publish("", [dataclasses.asdict(one) for one in found])
        return 0
    terminal.show(str(folder), [status_row(one) for one in found], essential=STATUS)
    failures = [failure for one in found for failure in one.failures]
    for name, why in failures[:_SHOWN]:
        terminal.say(f"{name}: {why}")
    if len(failures) > _SHOWN:
        terminal.say(f"and {len(failures) - _SHOWN} more (--json lists all)")
    return 0
