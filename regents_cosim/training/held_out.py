"""Whether training has paid, on windows that no round has seen: held out twice.

Attacks that were made against the planner before flatter the one after: it is elsewhere, and so they miss it. So the
one after is attacked again, in the same windows and as long.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from regents_cosim.evaluation.crashes.scores import is_telling
from regents_cosim.evaluation.drives.driving import DriveResult, score
from regents_cosim.scenario import Scenario
from regents_cosim.system.progress import Progress
from regents_cosim.training.before_after import BeforeAfterRow, before_after
from regents_cosim.training.learning import drives

Attacked = Sequence[Sequence[Scenario]]  # what an attack found in each window

ORDINARY = "ordinary"
OLD_ATTACKS = "attacks on the weights before"
OWN_ATTACKS = "attacks on each"


def telling_crashes(attacked: Attacked) -> list[Scenario]:
    """The crashes that a careful driver would have avoided, by a lawful adversary."""
    return [case for results in attacked for case in results if is_telling(case)]


def held_out_rows(
    windows: list[Scenario], attacked: tuple[Attacked, Attacked], weights: tuple[Path, Path], progress: Progress
) -> list[BeforeAfterRow]:
    """The same windows, before and after: as they were recorded, with the old attacks, and with attacks on each.

    `attacked` says what attacks on the weights before, and on those after, found in the windows. A crash of the last
    two rows is one that a careful driver avoids.
    """
    rows = before_after(ORDINARY, *_driven(windows, weights, progress))
    if old := telling_crashes(attacked[0]):
        rows += before_after(OLD_ATTACKS, *_driven(old, weights, progress))
    return rows + before_after(OWN_ATTACKS, *(list(map(attacked_drive, found)) for found in attacked))


def attacked_drive(results: Sequence[Scenario]) -> DriveResult:
    """How the planner drove in one window while it was attacked; a crash that tells nothing counts as none."""
    telling = next(filter(is_telling, results), None)
    case = telling or results[0]
    drive = score(case, case.tracks)
    return drive if telling else replace(drive, hits=None, step=None, collision_type=None)


def _driven(scenarios: list[Scenario], weights: tuple[Path, Path], progress: Progress) -> list[list[DriveResult]]:
    """By the weights before and after, which may be the same."""
    by_weights = {one: drives(scenarios, one, progress) for one in dict.fromkeys(weights)}
    return [by_weights[one] for one in weights]
