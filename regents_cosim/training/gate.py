"""The gate between two rounds of training: it passes weights that drive ordinary traffic as well as before."""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean

from regents_cosim.evaluation.drives.driving import DriveResult
from regents_cosim.evaluation.statistics import mcnemar, mean_interval
from regents_cosim.short_repr import ShortRepr
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
