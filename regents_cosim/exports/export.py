"""`export`: writes a case in the format of another tool."""

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from regents_cosim.checks.arguments import require_a, require_one_of
from regents_cosim.exports.commonroad import write_commonroad
from regents_cosim.exports.fcd import write_fcd
from regents_cosim.exports.openscenario import write_openscenario
from regents_cosim.exports.table import write_table
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.system.files.atomic import explain_write, new_folder, require_new

Format = Literal["fcd", "csv", "openscenario", "commonroad"]

_WRITERS: dict[Format, Callable[[Scenario, Path], list[str]]] = {
    "fcd": write_fcd,
    "csv": write_table,
    "openscenario": write_openscenario,
    "commonroad": write_commonroad,
}


def export(
    scenario: Scenario, to: Format, folder: Path | str, tell: Callable[[str], None] = warnings.warn
) -> list[Path]:
    """Write `scenario` in the format `to` into `folder`, new or empty; return its files.

    fcd is for SUMO, openscenario (1.2, with OpenDRIVE) for esmini and similar players, commonroad is version 2020a, csv
    is a table of all agents. Positions are kept to less than 1 mm. The folder appears as a whole or not at all.

    `tell` is called with a message on everything that the format cannot express, such as traffic lights in a table; a
    header in the file says so too.

    Raises RegentsError for an unknown format, for a `folder` that is not empty or cannot be written, and for a package
    that is missing.
    """
    require_one_of(to, tuple(_WRITERS), "to")
    require_a(Scenario, scenario, "export takes one case")
    folder = Path(folder)
    require_new(folder)
    with explain_write(folder):
        folder.absolute().parent.mkdir(parents=True, exist_ok=True)
        with new_folder(folder) as fresh:
            left_out = _WRITERS[to](scenario, fresh)
    for line in left_out:
        tell(f"{scenario.id} as {to}: {line}")
    return sorted(folder.iterdir())
