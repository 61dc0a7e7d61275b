"""What training has changed: a planner before and after it, on the same cases."""

from collections.abc import Sequence
from dataclasses import dataclass

from regents_cosim.evaluation.drives.driving import DriveResult, driving_row
from regents_cosim.evaluation.statistics import mcnemar
from regents_cosim.scenario import Scenario
from regents_cosim.short_repr import ShortRepr

_HELD_BACK = 5  # one window in so many


@dataclass(frozen=True, repr=False)
class BeforeAfterRow(ShortRepr):
    """One planner's scores on some cases, with 95 % intervals."""

    cases: str
    weights: str  # "before" or "after"
    n: int
    collisions: int
    collision_rate_percent: float
    collision_interval_percent: tuple[float, float]
    from_behind: int  # of them: another that replays a log drives into the ego, which may have braked
    route_completion_percent: float
    completion_interval_percent: tuple[float, float]
    alone: int  # cases in which only this one of the two collides
    p_value: float  # that both collide equally often (McNemar)


def before_after(cases: str, before: Sequence[DriveResult], after: Sequence[DriveResult]) -> list[BeforeAfterRow]:
    """Two rows on the same cases, in the same order."""
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


def hold_back(scenarios: Sequence[Scenario], after: int = 0) -> tuple[list[Scenario], list[Scenario]]:
    """Those to train on, and those of every fifth window to judge by; no window is on both sides.

    `after` is how many windows were divided before: they count as well.
    """
    windows = sorted(windows_among(scenarios))
    held = {window for at, window in enumerate(windows, after + 1) if at % _HELD_BACK == 0}
    return [s for s in scenarios if _window(s) not in held], [s for s in scenarios if _window(s) in held]


def windows_among(scenarios: Sequence[Scenario]) -> set[str]:
    """The windows that they are of: of an attacked case, that which was attacked."""
    return {_window(scenario) for scenario in scenarios}


def _window(scenario: Scenario) -> str:
    return scenario.attack.case if scenario.attack else scenario.id
