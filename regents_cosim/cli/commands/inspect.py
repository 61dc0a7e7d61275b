"""`regents inspect`: what logged traffic holds."""

import dataclasses
from pathlib import Path

from regents_cosim.cli.options import OutputIfAny, OutputOptions
from regents_cosim.cli.shared import open_terminal


def inspect(
    log: Path,
    *,
    format: str = "auto",
    map: Path | None = None,
    columns: Path | None = None,
    output: OutputIfAny = None,
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Say what logged traffic holds, and draw it.

    Parameters
    ----------
    log
        a file of logged traffic, or a folder of files
    format
        of the log; auto tells it by the content
    map
        lanelet2 map (.osm) that does not lie beside the log
    columns
        TOML file that names the columns of a table (csv, parquet)
    output
        folder for one picture per scenario
    """
    from regents_cosim.reports.log_picture import draw_scene
    from regents_cosim.reports.tables import INSPECTED, inspection_notes, inspection_row
    from regents_cosim.sources.logs.formats import CompanionFiles
    from regents_cosim.sources.logs.inspection import inspect_scene
    from regents_cosim.sources.logs.record import scenes_of

    terminal = open_terminal(talk)
    found = []
    for _, name, scene in scenes_of(log, format, CompanionFiles(map, columns)):
        found.append(inspect_scene(scene, name))
        if output is not None:
            draw_scene(scene, output)
    rows = [dataclasses.asdict(one) if talk.json else inspection_row(one) for one in found]
    terminal.show(f"{len(rows)} scenarios in {log}", rows, inspection_notes(found), INSPECTED)
    return 0
