"""`regents inspect`: shows the content of logged traffic, or compares cases with their log."""

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

from regents_cosim.cli.options import OutputIfAny, OutputOptions
from regents_cosim.cli.shared import open_terminal
from regents_cosim.errors import NEGATIVE_VERDICT, RegentsError
from regents_cosim.plain_text import counted

if TYPE_CHECKING:
    from regents_cosim.cli.terminal import Terminal
    from regents_cosim.sources.logs.formats import CompanionFiles


def inspect(
    log: Path,
    *,
    compare_with: Path | None = None,
    radius: float = 100.0,
    format: str = "auto",
    map: Path | None = None,
    columns: Path | None = None,
    output: OutputIfAny = None,
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Show the content of logged traffic in numbers and pictures, or what cases leave out of the log they come from.

    Parameters
    ----------
    log
        a file of logged traffic, a folder of files, a case, or a folder of cases
    compare_with
        the log that the cases were recorded from, or an fcd-output of the run: shows which of its road users they lack,
        and how far positions, headings and sizes differ; exit code 1 if a case lacks one without listing it as left out
    radius
        distance from the ego within which road users of that log are compared [m]
    format
        format of the log; auto recognises it by the content
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
    if cases := _cases(log):
        return _inspect_cases(cases, compare_with, CompanionFiles(map, columns), format, radius, terminal)
    if compare_with is not None:
        raise RegentsError(f"{log}: no case, expected one, or a folder of cases, beside --compare-with")
    found = []
    for _, name, scene in scenes_of(log, format, CompanionFiles(map, columns)):
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


def _inspect_cases(
    cases: list[Path],
    compare_with: Path | None,
    beside: "CompanionFiles",
    format: str,
    radius: float,
    terminal: "Terminal",
) -> int:
    from regents_cosim.cases.files import load_case
    from regents_cosim.reports.tables import HELD_AGAINST, RECORDED, case_row, compared_row
    from regents_cosim.sources.comparison import compare_with_fcd, compare_with_log
    from regents_cosim.sources.fcd import is_fcd
    from regents_cosim.sources.left_out import sentence_of

    scenarios = [load_case(case) for case in cases]
    for one in scenarios:
        for entry in one.provenance.left_out:
            terminal.say(f"{one.id}: {sentence_of(entry)}")
    if compare_with is None:
        terminal.show(counted(len(cases), "case"), [case_row(one) for one in scenarios], essential=RECORDED)
        return 0
    rows, lacking = [], 0
    if is_fcd(compare_with):
        compared = compare_with_fcd(scenarios, compare_with, radius)
    else:
        compared = compare_with_log(scenarios, compare_with, format, beside, radius)
    for one, found in zip(scenarios, compared, strict=True):
        unexplained = found.unexplained(one)
        for name, instants in sorted(unexplained.items()):
            terminal.say(f"{one.id}: {name!r} is missing at {instants} instants, which the case does not say")
        lacking += len(unexplained)
        rows.append(compared_row(found, len(unexplained)))
    terminal.show(f"{counted(len(cases), 'case')} against {compare_with}", rows, essential=HELD_AGAINST)
    return NEGATIVE_VERDICT if lacking else 0
