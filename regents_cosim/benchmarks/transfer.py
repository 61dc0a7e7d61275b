"""Whether crashes survive the transfer into a simulator, and how exactly tracks are reproduced there."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np
from jaxtyping import Float

from regents_cosim.errors import PlannerError
from regents_cosim.evaluation.statistics import percent, percent_interval
from regents_cosim.planners.find import planner_of
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.replays.replay import Background, Mode, Simulator, replay_each
from regents_cosim.replays.verify import Replay, failed
from regents_cosim.scenario.scenario import Scenario


@dataclass(frozen=True)
class ReplayPlace:
    """Where cases are replayed, and who is scripted there."""

    name: str
    where: Simulator
    mode: Mode = "track"
    background: Background = "log"
    planner_drives: bool = False  # the attacked one, in closed loop; otherwise the ego is on its track


PLACES = (
    ReplayPlace("SUMO", "sumo"),
    ReplayPlace("SUMO, reactive", "sumo", background="reactive"),
    ReplayPlace("SUMO, reactive, planner drives", "sumo", background="reactive", planner_drives=True),
    ReplayPlace("highway-env, track", "highway"),
    ReplayPlace("highway-env, actions", "highway", mode="actions"),
)


@dataclass(frozen=True)
class TransferRow:
    """A suite in one place."""

    place: str
    cases: int
    crashes: int
    same_crash: int  # of the crashes: the same agent at the same step, by our boxes
    same_crash_percent: float
    interval_percent: tuple[float, float]  # 95 %, Wilson
    same_agent: int  # of the crashes: the same agent, at whatever step
    steps_apart_median: float | None  # of those, from the step in the case
    steps_apart_max: int | None
    shift_median_mm: float | None  # of those: how far from its place in the case the collision happens
    shift_max_mm: float | None
    invented: int  # cases without a crash that have one there
    own_list: int  # of the crashes: the simulator itself says so
    position_error_mm: float  # of the scripted, the largest over all cases, agents and steps
    yaw_error_deg: float
    driven: int  # agents that the simulator drove
    unmatched: int  # agents that it was to drive, but has no route for: scripted


def transfer(
    cases: Sequence[Scenario], places: Sequence[ReplayPlace] = PLACES, planner: str | None = None
) -> Iterator[tuple[TransferRow, list[Replay]]]:
    """What becomes of `cases`, place by place, with their replays there.

    SUMO's own traffic is a place where all come from SUMO, planners drive where all were attacked: `planner`, or
    the one that each was attacked with. A case that a place cannot replay is one without a crash there; its replay
    says why. Raises PlannerError before any replay for a planner that a case names and that is not ours.
    """
    possible = [place for place in places if _takes(place, cases)]
    driven = any(place.planner_drives for place in possible)
    named = [planner_of(case, planner) if driven else None for case in cases]
    given = {name: PlannerUnderTest.of(name) for name in named if name is not None}
    drivers = [None if name is None else given[name] for name in named]
    for place in possible:
        replays = _replayed(cases, drivers if place.planner_drives else [None] * len(cases), place)
        yield transfer_row(place.name, cases, replays), replays


def _takes(place: ReplayPlace, cases: Sequence[Scenario]) -> bool:
    if place.background == "reactive" and not all(case.road.sumo_net for case in cases):
        return False
    return not place.planner_drives or all(case.attack for case in cases)


def _replayed(
    cases: Sequence[Scenario], drivers: Sequence[PlannerUnderTest | None], place: ReplayPlace
) -> list[Replay]:
    """In the order of `cases`, each with its driver; None: the ego follows its track."""
    found = dict[str, Replay]()
    for planner in dict.fromkeys(drivers):
        own = [case for case, driver in zip(cases, drivers, strict=True) if driver == planner]
        try:
            replays = list(replay_each(own, place.where, planner, mode=place.mode, background=place.background))
        except PlannerError as error:
            replays = [failed(case, error) for case in own]
        found |= {replay.case: replay for replay in replays}
    return [found[case.id] for case in cases]


def transfer_row(place: str, cases: Sequence[Scenario], replays: Sequence[Replay]) -> TransferRow:
    """What became of `cases` in one place, by their `replays` there."""
    crashes = [replay for replay in replays if replay.expected is not None]
    same = sum(replay.found == replay.expected for replay in crashes)
    apart = [abs(r.found[1] - r.expected[1]) for r in crashes if r.found and r.expected and r.shift_m is not None]
    shifts = [1e3 * replay.shift_m for replay in crashes if replay.shift_m is not None]
    return TransferRow(
        place=place,
        cases=len(cases),
        crashes=len(crashes),
        same_crash=same,
        same_crash_percent=percent(same, len(crashes)),
        interval_percent=percent_interval(same, len(crashes)),
        same_agent=len(apart),
        steps_apart_median=float(median(apart)) if apart else None,
        steps_apart_max=max(apart, default=None),
        shift_median_mm=median(shifts) if shifts else None,
        shift_max_mm=max(shifts, default=None),
        invented=sum(replay.expected is None and replay.found is not None for replay in replays),
        own_list=sum(replay.reports_same_pair for replay in crashes),
        position_error_mm=max((_worst(replay.position_error_m) for replay in replays), default=0.0) * 1e3,
        yaw_error_deg=max((_worst(replay.yaw_error_deg) for replay in replays), default=0.0),
        driven=sum(len(replay.driven) for replay in replays),
        unmatched=sum(len(replay.unmatched) for replay in replays),
    )


def _worst(errors: Float[np.ndarray, "agent time"] | None) -> float:
    return 0.0 if errors is None else float(errors.max(initial=0.0))
