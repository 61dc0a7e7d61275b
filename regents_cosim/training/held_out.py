"""Measures the benefit of a training on windows that no round has seen.

Attacks on the planner before training flatter the planner after it, which is elsewhere and so is missed. So the planner
after training is attacked again, in the same windows and for as long.
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

Attacked = Sequence[Sequence[Scenario]]  # the results of an attack in each window

ORDINARY = "ordinary"
OLD_ATTACKS = "attacks on the weights before"
OWN_ATTACKS = "attacks on each"


def telling_crashes(attacked: Attacked) -> list[Scenario]:
    """The crashes with a lawful adversary that a careful driver would have avoided."""
    return [case for results in attacked for case in results if is_telling(case)]


def held_out_rows(
    windows: list[Scenario], attacked: tuple[Attacked, Attacked], weights: tuple[Path, Path], progress: Progress
) -> list[BeforeAfterRow]:
    """Score the weights before and after in the same windows: as recorded, with the old attacks, with attacks on each.

    `attacked` has the results of attacks on the weights before, and on those after. In the last two rows only crashes
    count that a careful driver avoids.
    """
    rows = before_after(ORDINARY, *_driven(windows, weights, progress))
    if old := telling_crashes(attacked[0]):
        rows += before_after(OLD_ATTACKS, *_driven(old, weights, progress))
    return rows + before_after(OWN_ATTACKS, *(list(map(attacked_drive, found)) for found in attacked))


def attacked_drive(results: Sequence[Scenario]) -> DriveResult:
    """The drive of the planner in one attacked window; a crash that is not telling does not count."""
    telling = next(filter(is_telling, results), None)
    case = telling or results[0]
    drive = score(case, case.tracks)
    return drive if telling else replace(drive, hits=None, step=None, collision_type=None)


def _driven(scenarios: list[Scenario], weights: tuple[Path, Path], progress: Progress) -> list[list[DriveResult]]:
    """The drives of the weights before and after, which may be the same."""
    by_weights = {one: drives(scenarios, one, progress) for one in dict.fromkeys(weights)}
    return [by_weights[one] for one in weights]
