"""`regents gallery`: draws the figures of the ReGentS paper."""

from regents_cosim.cli.options import Output, OutputOptions, ProgramOptions
from regents_cosim.cli.shared import open_terminal


def gallery(
    *,
    output: Output,
    programs: ProgramOptions = ProgramOptions(),
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Draw the figures of the ReGentS paper: gradients around the ego, and how KING fails.

    Parameters
    ----------
    output
        folder for the pictures, their page README.md, and the cases behind them
    """
    from regents_cosim.benchmarks.gallery.make import make_gallery
    from regents_cosim.reports.tables import ATTACKED, attack_row

    terminal = open_terminal(talk)
    programs.keep()
    with terminal.waiting("making the gallery"):
        attacked = make_gallery(output)
    rows = [attack_row(scenario, None) for scenario in attacked]
    note = f"pictures and what they show: {output / 'README.md'}"
    terminal.show(f"{len(rows)} attacked scenes", rows, note, ATTACKED)
    return 0
