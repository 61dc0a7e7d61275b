"""`regents inspect` and `status`: show the content of logged traffic or of cases, and the progress of a run."""

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

from regents_cosim.cli.options import OutputIfAny, OutputOptions
from regents_cosim.cli.shared import open_terminal
from regents_cosim.plain_text import counted

if TYPE_CHECKING:
    from regents_cosim.cli.terminal import Terminal

_SHOWN = 10  # most failures shown


def inspect(
    log: Path,
    *,
    format: str = "auto",
    map: Path | None = None,
    columns: Path | None = None,
    output: OutputIfAny = None,
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Show the content of logged traffic in numbers and pictures, or what cases hold and leave out.

    Parameters
    ----------
    log
        a file of logged traffic, a folder of files, a case, or a folder of cases
    format
        format of the log; auto recognises it by the content, a wrong name lists all formats
    map
        lanelet2 map (.osm) of the log, if it is not in the folder of the log
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
    if cases := _cases(log):
        return _show_cases(cases, terminal)
    found = []
    for _, name, scene in scenes_of(log, format, CompanionFiles(map, columns), terminal.say):
        found.append(inspect_scene(scene, name))
        if output is not None:
            draw_scene(scene, output)
    rows = [dataclasses.asdict(one) if talk.json else inspection_row(one) for one in found]
    terminal.show(f"{counted(len(rows), 'scenario')} in {log}", rows, inspection_notes(found), INSPECTED)
    return 0


def _cases(path: Path) -> list[Path]:
    """The folders of the cases at a path; empty for a log."""
    from regents_cosim.cases.header import HEADER

    if (path / HEADER).is_file():
        return [path]
    return sorted(one.parent for one in path.glob(f"*/{HEADER}")) if path.is_dir() else []


def _show_cases(cases: list[Path], terminal: "Terminal") -> int:
    from regents_cosim.cases.files import load_case
    from regents_cosim.reports.tables import RECORDED, case_row
    from regents_cosim.sources.left_out import sentence_of

    scenarios = [load_case(case) for case in cases]
    for one in scenarios:
        for entry in one.provenance.left_out:
            terminal.say(f"{one.id}: {sentence_of(entry)}")
    terminal.show(counted(len(cases), "case"), [case_row(one) for one in scenarios], essential=RECORDED)
    return 0


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
        terminal.publish("", found.to_dict())
        return 0
    terminal.show(str(folder), [status_row(one) for one in found], essential=STATUS)
    failures = [failure for one in found for failure in one.failures]
    for name, why in failures[:_SHOWN]:
        terminal.say(f"{name}: {why}")
    if len(failures) > _SHOWN:
        terminal.say(f"and {len(failures) - _SHOWN} more (--json lists all)")
    return 0
