"""Measures how well a planner drives, per case and over all cases."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import tee
from statistics import fmean
from typing import Any

import numpy as np

from regents_cosim.errors import DriveError
from regents_cosim.evaluation.drives.crash_verdict import (
    CaseEnd,
    CrashCounts,
    CrashVerdict,
    is_ordinary,
    verdict_of_drive,
)
from regents_cosim.evaluation.drives.ego_drive import EgoDrive
from regents_cosim.evaluation.drives.metrics import METRICS, Column, DriveScores, measured
from regents_cosim.planners.controllers import PlannerControllers
from regents_cosim.planners.interface import DebugSteps
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S
from regents_cosim.planners.under_test import AnyPlanner, PlannerUnderTest
from regents_cosim.replays.mirror import MirrorController
from regents_cosim.replays.replay import Background, Simulator, check, replay_each
from regents_cosim.scenario.attack_record import CollisionType
from regents_cosim.scenario.scenario import Scenario, Tracks
from regents_cosim.short_repr import ShortRepr, in_short
from regents_cosim.system.progress import logs_items
from regents_cosim.system.workers import in_turn
from regents_cosim.verdicts.judge import up_to_date

_AS_FAR = 0.8  # of a careful driver's progress in a harmless case


@dataclass(frozen=True, repr=False)
class DriveResult(DriveScores):
    """The drive of one case, with its scores."""

    hits: str | None = None  # agent that the ego meets
    step: int | None = None  # of the contact
    collision_type: CollisionType | None = None
    act_s: tuple[float, ...] = ()  # duration of each decision of a planner outside the mirror
    error: str = ""  # message of a planner that failed, which counts as no progress
    trace: str = ""  # traceback of a planner that failed
    debug: DebugSteps = ()  # what a planner outside the mirror thought before its crash
    verdict: CrashVerdict | None = None  # on the crash; None where there is none, or it was not judged
    ordinary: bool = False  # the case has no attack
    telling_case: bool = False  # the attacked case has a telling crash, whatever this drive does
    careful_completion: float | None = None  # completion of a careful driver, in a harmless neighbour of a crash
    rear_ended: bool = (
        False  # a follower that replays its log, and so cannot brake, drives into the ego's rear: no collision
    )

    def row(self) -> dict[str, object]:
        """Its values for a data frame, with the mean duration of decisions, and whether its crash is telling."""
        left_out = ("act_s", "trace", "verdict", "debug")
        values = {field.name: getattr(self, field.name) for field in fields(self) if field.name not in left_out}
        said = self.verdict
        act_ms = 1e3 * fmean(self.act_s) if self.act_s else None
        return values | {
            "act_mean_ms": act_ms, "telling": said and said.telling, "flawless": said and said.flawless,
            "clean": said and said.clean, "at_fault": said and said.at_fault,
            "prevention": said and said.prevention,
        }  # fmt: skip

    @property
    def collision(self) -> bool:
        """Whether the ego collides."""
        return self.hits is not None and not self.rear_ended

    @property
    def ending(self) -> str:
        """The outcome in a few words."""
        if self.error:
            return "the planner failed"
        how = "rear-ended by" if self.rear_ended else "collision with"
        return "no collision" if self.hits is None else f"{how} {self.hits} at step {self.step}"

    @property
    def end(self) -> CaseEnd:
        """The end of the drive, for counting."""
        return CaseEnd(self.collision, self.ordinary, self.verdict, self.error.partition("\n")[0])

    @property
    def words(self) -> str:
        """What happens in its crash and what prevents it; empty without a crash."""
        return self.verdict.words if self.verdict else ""

    @property
    def held_up(self) -> bool:
        """Whether it gets less than 80 % as far as a careful driver in a harmless case."""
        return self.careful_completion is not None and self.completion < _AS_FAR * self.careful_completion


DriveWithTracks = tuple[DriveResult, Tracks | None]  # tracks of all agents; None where the planner failed


def _grade(name: str, grade: str, meaning: str, **shown: Any) -> Column:
    return Column(name, lambda drives: getattr(CrashCounts.of(drive.end for drive in drives), grade), meaning, **shown)


def _number(name: str, what: Callable[[DriveResult], bool], meaning: str, **shown: Any) -> Column:
    return Column(name, lambda drives: sum(map(what, drives)), meaning, **shown)


def _act_ms(drives: Sequence[DriveResult], percent: int) -> float | None:
    act_s = [second for drive in drives for second in drive.act_s]
    return round(1e3 * float(np.percentile(act_s, percent)), 3) if act_s else None


COUNTS = (
    _grade("telling_collisions", "telling", "telling crashes of the planner", essential=True),
    _grade("flawless_collisions", "flawless", "those whose adversary keeps all rules that can be told", essential=True),
    _grade("telling_unknown", "telling_unknown", "collisions of which it is not known whether they are telling"),
    _number("telling_cases", lambda drive: drive.telling_case, "cases whose attack ended in a telling crash"),
    _number("harmless_cases", lambda drive: drive.careful_completion is not None, "harmless neighbours of crashes"),
    _number("held_up", lambda drive: drive.held_up, "those in which the planner is held up", essential=True),
    _grade("ordinary_collisions", "ordinary", "collisions without an attack"),
    _number("rear_ended", lambda drive: drive.rear_ended,
            "drives that end with a follower that replays its log in the ego's rear", essential=True),
    _grade("planner_errors", "failed", "cases in which the planner failed, which count as no progress",
           label="Planner failed", detail="of {cases}"),
    Column("act_median_ms", partial(_act_ms, percent=50), "median duration of a decision, of planners outside JAX",
           "Decision time", "99 % within {act_p99_ms:.3g} ms", "{:.3g} ms"),
    Column("act_p99_ms", partial(_act_ms, percent=99), "its 99th percentile"),
)  # fmt: skip
COLUMNS = (*COUNTS, *(column for one in METRICS for column in one.columns))


@dataclass(frozen=True, repr=False)
class DrivingRow(ShortRepr):
    """A planner's scores over cases: the means of `METRICS` and the `COUNTS`, each an attribute by its name."""

    source: str
    n: int
    columns: Mapping[str, Any]

    def __getattr__(self, name: str) -> Any:
        if name not in vars(self).get("columns", ()):
            raise AttributeError(f"{type(self).__name__} has no {name!r}", name=name, obj=self)
        return self.columns[name]

    def row(self) -> dict[str, Any]:
        """Its values for a table."""
        return {"source": self.source, "n": self.n, **self.columns}

    def in_short(self) -> dict[str, str]:
        """The columns by name, each value in a few words."""
        return {name: in_short(value) for name, value in self.row().items()}


def _went(drive: DriveResult) -> str:
    return f"drove {drive.case}: {drive.error or drive.ending}"


@logs_items(_went)
def drive_each(
    scenarios: Iterable[Scenario],
    planner: AnyPlanner,
    act_timeout_s: float = ACT_TIMEOUT_S,
    where: Simulator = "mirror",
    executor: Executor | None = None,
    drivers: PlannerControllers | None = None,
    background: Background = "log",
) -> Iterator[DriveResult]:
    """Let `planner` drive every case, in order, to the end of its horizon or its first collision.

    In SUMO the others follow their tracks; with `background` reactive SUMO drives all but the adversary.

    SUMO runs in separate processes, or those of `executor`. If the planner or the simulator fails in a case, its
    result says so. `drivers` are the planner's drivers for highway-env, where the caller already has them. Raises
    PlannerError where the planner cannot be found.
    """
    check(where, background=background, act_timeout_s=act_timeout_s)
    given = PlannerUnderTest.of(planner)
    if where == "mirror":
        yield from (drive for drive, _ in drive_in_mirror(scenarios, given, act_timeout_s))
        return
    scenarios, replayed = tee(scenarios)
    replays = replay_each(
        replayed, where, given, executor=executor, background=background, act_timeout_s=act_timeout_s, drivers=drivers
    )
    for scenario, one in zip(scenarios, replays, strict=True):
        if one.replayed is None:
            yield failed_drive(scenario, one.reason, one.trace)
        else:
            yield replace(judged(scenario, given.name, one.replayed.tracks), debug=one.debug)


def drive_in_mirror(
    scenarios: Iterable[Scenario], planner: AnyPlanner, act_timeout_s: float = ACT_TIMEOUT_S
) -> Iterator[DriveWithTracks]:
    """Let `planner` drive every case in the mirror, in order. Raises PlannerError where it cannot be found."""
    with MirrorController(planner, act_timeout_s) as driver:
        yield from in_turn(partial(drive_and_keep, driver=driver), scenarios)


def drive_and_keep(scenario: Scenario, driver: MirrorController) -> DriveWithTracks:
    """The drive of one case to the end of its horizon or its first collision, with the tracks of all agents."""
    try:
        driven = driver.drive(scenario)
    except DriveError as failure:
        return failed_drive(scenario, str(failure), failure.trace), None
    made = judged(scenario, driver.planner.name, driven.tracks)
    return replace(made, act_s=tuple(driven.act_seconds), debug=driven.debug), driven.tracks


def driving_rows(drives: Sequence[DriveResult]) -> list[DrivingRow]:
    """A row for each source of traffic, and one for all sources."""
    sources = sorted({drive.source for drive in drives})
    rows = [driving_row(source, [drive for drive in drives if drive.source == source]) for source in sources]
    return rows if len(rows) == 1 else [*rows, driving_row("all", drives)]


def driving_row(source: str, drives: Sequence[DriveResult]) -> DrivingRow:
    """The means and rates of some drives."""
    values = {column.name: column.of(drives) for column in COUNTS}
    for one in METRICS:
        known = [value for drive in drives if (value := getattr(drive, one.field)) is not None]
        values |= {column.name: column.of(known) if known else column.unknown for column in one.columns}
    return DrivingRow(source, len(drives), values)


def failed_drive(scenario: Scenario, error: str, trace: str = "") -> DriveResult:
    """The drive of a planner or simulator that failed."""
    return DriveResult(scenario.id, scenario.provenance.file, error=error, trace=trace, **_of_case(scenario))


def score(scenario: Scenario, tracks: Tracks) -> DriveResult:
    """The scores of an ego that has driven along `tracks`, to the end of the horizon or its first collision."""
    drive = EgoDrive.of(scenario, tracks)
    contact = drive.contact
    made = DriveResult(scenario.id, scenario.provenance.file, **measured(drive), **_of_case(scenario))
    if contact is None:
        return made
    return replace(
        made,
        hits=scenario.agents[contact[0]].id,
        step=contact[1],
        collision_type=drive.collision_type,
        rear_ended=drive.rear_ended,
    )


def judged(scenario: Scenario, planner: str, tracks: Tracks) -> DriveResult:
    """The scores of `planner`, which has driven along `tracks`, with a verdict on its crash."""
    made = score(scenario, tracks)
    return replace(made, verdict=verdict_of_drive(scenario, planner, tracks)) if made.collision else made


def _of_case(scenario: Scenario) -> dict[str, Any]:
    attack, judgement = scenario.attack, up_to_date(scenario).judgement
    return {
        "ordinary": is_ordinary(scenario),
        "telling_case": judgement is not None and judgement.telling is True,
        "careful_completion": attack.careful_completion if attack else None,
    }
