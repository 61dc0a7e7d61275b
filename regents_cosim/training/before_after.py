"""Compares a planner before and after a training, on the same cases."""

from collections.abc import Sequence
from dataclasses import dataclass

from regents_cosim.evaluation.drives.driving import DriveResult, driving_row
from regents_cosim.evaluation.statistics import mcnemar
from regents_cosim.short_repr import ShortRepr


@dataclass(frozen=True, repr=False)
class BeforeAfterRow(ShortRepr):
    """The scores of one planner on some cases, with 95 % intervals."""

    cases: str
    weights: str  # "before" or "after"
    n: int
    collisions: int
    collision_rate_percent: float
    collision_interval_percent: tuple[float, float]
    from_behind: int  # collisions in which an agent on its log drives into the ego, which may have braked
    route_completion_percent: float
    completion_interval_percent: tuple[float, float]
    alone: int  # cases in which this planner collides and the other does not
    p_value: float  # p-value of the hypothesis that both collide equally often (McNemar)


def before_after(cases: str, before: Sequence[DriveResult], after: Sequence[DriveResult]) -> list[BeforeAfterRow]:
    """The rows of both planners on the same cases, in the same order."""
    hits = [[drive.hits is not None for drive in drives] for drives in (before, after)]
    p_value = round(mcnemar(*hits), 4)
    rows = []
    for weights, drives, mine, others in (("before", before, *hits), ("after", after, *hits[::-1])):
        row = driving_row(cases, drives)
        rows.append(
            BeforeAfterRow(
                cases,
                weights,
                row.n,
                row.collisions,
                row.collision_rate_percent,
                row.collision_interval_percent,
                sum(drive.collision_type == "rear_end_by_adversary" for drive in drives),
                row.route_completion_percent,
                row.completion_interval_percent,
                alone=sum(a and not b for a, b in zip(mine, others, strict=True)),
                p_value=p_value,
            )
        )
    return rows
