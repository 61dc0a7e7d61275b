"""`regents attack --into`: adds new crashes to an existing suite for a given time."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from regents_cosim.errors import PLANNER_FAILED
from regents_cosim.plain_text import counted

if TYPE_CHECKING:
    from regents_cosim.cli.terminal import Terminal
    from regents_cosim.runs.archive.axes import Axes
    from regents_cosim.runs.growing import AddedCrash, Growth

_MOST_SHOWN = 6  # most cells named in a line


def show_growth(growth: "Growth", suite: Path, planner: str, axes: "Axes", terminal: "Terminal") -> int:
    """Show what was added to a suite, and return the exit code."""
    title = f"{counted(len(growth.added), 'case')} added to {suite}, found in {counted(growth.windows, 'window')}"
    terminal.show(title, [_row(one, axes) for one in growth.added], _note(growth, planner), ("case", "why"))
    for error in growth.errors:
        terminal.say(error.partition("\n")[0])
    return PLANNER_FAILED if growth.errors else 0


def _row(added: "AddedCrash", axes: "Axes") -> dict[str, Any]:
    return {
        "case": added.crash.case,
        "why": added.why,
        **dict(zip(axes.names, added.cell, strict=True)),
        "standing": added.crash.standing,
        "quality": round(added.crash.quality, 3),
        "than": added.than or None,
    }


def _note(growth: "Growth", planner: str) -> str:
    """A summary of the cells in which the planner newly fails, and of how the run ended."""
    new = [one for one in growth.added if one.why == "new cell"]
    cells = "; ".join(" ".join(one.cell) for one in new[:_MOST_SHOWN]) + ("; ..." if len(new) > _MOST_SHOWN else "")
    known = growth.crashes - len(growth.added)
    said = [f"{planner} crashes in {counted(growth.crashes, 'case')}, {known} of them of kinds known"]
    if new:
        said.append(f"{planner} newly fails in {len(new)} cells: {cells}")
    if growth.used_up:
        said.append("there are no more windows: another --seed or a larger --count gives other traffic")
    return "\n".join(said)
