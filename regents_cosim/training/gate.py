"""The gate between two rounds of training, and the benefit of all of them on windows that no round has seen.

The gate passes weights that drive ordinary traffic as well as before. Attacks on the planner before training flatter
the planner after it, which is elsewhere and so is missed. So the planner after training is attacked again, in the same
windows and for as long.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean

from regents_cosim.evaluation.crashes.scores import is_telling
from regents_cosim.evaluation.drives.driving import DriveResult, score
from regents_cosim.evaluation.statistics import mcnemar, mean_interval
from regents_cosim.scenario import Scenario
from regents_cosim.short_repr import ShortRepr
from regents_cosim.system.progress import Progress
from regents_cosim.training.before_after import BeforeAfterRow, before_after
from regents_cosim.training.learning import drives
from regents_cosim.training.mixture import AT_MOST_WORSE


@dataclass(frozen=True, repr=False)
class Gate(ShortRepr):
    """The comparison of drives before and after, case by case. The means decide; the interval shows their certainty."""

    ordinary: int  # cases
    routes_before_percent: float  # mean share of the route that is driven
    routes_after_percent: float
    lost_points: float  # difference in the driven share of routes, mean over the cases
    lost_interval_points: tuple[float, float] | None  # 95 %; None for fewer than two cases
    collisions_before: int
    collisions_after: int
    p_value: float  # p-value of the hypothesis that both collide equally often (McNemar)
    passed: bool  # True if at most 2 points of route are lost, without more collisions

    @property
    def said(self) -> str:
        """The comparison in words."""
        low_high = self.lost_interval_points
        sure = f" ({low_high[0]:g} to {low_high[1]:g})" if low_high else ""
        return (
            f"{self.ordinary} ordinary routes {self.routes_before_percent:g} % -> {self.routes_after_percent:g} %, "
            f"{self.lost_points:g} points lost{sure}, collisions {self.collisions_before} -> {self.collisions_after}: "
            f"{'passed' if self.passed else 'not passed, the weights stay'}"
        )


def gate(before: Sequence[DriveResult], after: Sequence[DriveResult]) -> Gate:
    """Compare drives of the same cases in the same order. `before` are the drives of the planner before all rounds.

    Thereby small losses of several rounds cannot add up unnoticed.
    """
    lost = [a.completion - b.completion for a, b in zip(before, after, strict=True)]
    hits = [[drive.hits is not None for drive in drives] for drives in (before, after)]
    return Gate(
        ordinary=len(lost),
        routes_before_percent=_points(fmean(drive.completion for drive in before)),
        routes_after_percent=_points(fmean(drive.completion for drive in after)),
        lost_points=_points(fmean(lost)),
        lost_interval_points=_interval(lost),
        collisions_before=sum(hits[0]),
        collisions_after=sum(hits[1]),
        p_value=round(mcnemar(*hits), 4),
        passed=fmean(lost) <= AT_MOST_WORSE and sum(hits[1]) <= sum(hits[0]),
    )


def _interval(lost: Sequence[float]) -> tuple[float, float] | None:
    if len(lost) < 2:
        return None
    low, high = mean_interval(lost)
    return _points(low), _points(high)


def _points(share: float) -> float:
    return round(100.0 * share, 1)


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
