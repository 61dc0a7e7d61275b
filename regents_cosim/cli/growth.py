"""`regents attack --into`: adds new crashes to an existing suite for a given time."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from regents_cosim.cli.campaign import AttackInput, digest_of
from regents_cosim.cli.shared import record_traffic
from regents_cosim.errors import PLANNER_FAILED

if TYPE_CHECKING:
    from collections.abc import Sequence

    from regents_cosim.archive.axes import Axes
    from regents_cosim.campaign.growing import Budget, Growth
    from regents_cosim.campaign.intake import AddedCrash
    from regents_cosim.campaign.window_job import AttackRun
    from regents_cosim.cli.terminal import Terminal
    from regents_cosim.scenario import Scenario

_MOST_SHOWN = 6  # most cells named in a line


def grow_suite(
    suite: Path,
    run: "AttackRun",
    given: AttackInput,
    axes: "Axes",
    budget: "Budget",
    output: Path | None,
    terminal: "Terminal",
) -> int:
    """Add to a suite the new crashes found within a time budget, and return the exit code. Raises RegentsError."""
    from regents_cosim.archive.coverage import archive_of
    from regents_cosim.campaign.explored import open_explored
    from regents_cosim.campaign.growing import GrowingSuite
    from regents_cosim.campaign.intake import SuiteIntake
    from regents_cosim.cases.manifest import find_cases, load_manifest
    from regents_cosim.cases.shipped import require_own
    from regents_cosim.reports.picture import still
    from regents_cosim.saving import SuiteWriter
    from regents_cosim.system.atomic import require_writable

    require_own(suite, "--into")
    require_writable(suite)
    load_manifest(suite)
    copy = None if output is None else SuiteWriter(output, given.traffic.seed).add
    key = run.identity({}, run.together()).key(*axes.names)
    explored = open_explored(suite, key, run.planner.name, run.config.label)
    picture = still if run.pictures else None
    intake = SuiteIntake(suite, archive_of(find_cases(suite), axes), picture, run.verify, copy)
    growth = GrowingSuite(intake, explored, run).grow(
        _traffic(given), lambda number: _round(given, number, terminal), budget
    )
    title = f"{len(growth.added)} cases added to {suite}, found in {growth.windows} windows"
    terminal.show(title, [_row(one, axes) for one in growth.added], _note(growth, run.planner.name), ("case", "why"))
    for error in growth.errors:
        terminal.say(error.partition("\n")[0])
    return PLANNER_FAILED if growth.errors else 0


def _traffic(given: AttackInput) -> str:
    """A description of the recorded traffic, or of the cases."""
    import hashlib
    import json

    from regents_cosim.campaign.windows import windows_in

    from_what = windows_in(given.cases).hashes if given.cases else [given.settings(), digest_of(given)]
    return hashlib.sha256(json.dumps(from_what, sort_keys=True, default=str).encode()).hexdigest()[:20]


def _round(given: AttackInput, number: int, terminal: "Terminal") -> "Sequence[Scenario]":
    """The windows of a round: traffic with another seed each time; cases give a single round."""
    from regents_cosim.cases.suite import load_suite

    if given.cases is not None:
        return load_suite(given.cases) if number == 0 else []
    return record_traffic(replace(given.traffic, seed=given.traffic.seed + number), given.sumo, None, terminal)


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
    said = [f"{planner} crashes in {growth.crashes} cases, {growth.crashes - len(growth.added)} of them of kinds known"]
    if new:
        said.append(f"{planner} newly fails in {len(new)} cells: {cells}")
    if growth.used_up:
        said.append("there are no more windows: another --seed or a larger --count gives other traffic")
    return "\n".join(said)
