"""Measures how well a planner drives, per case and over all cases."""

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from itertools import tee
from statistics import fmean
from typing import Any

import numpy as np
import shapely
from jaxtyping import Bool, Float

from regents_cosim.attack_record import CollisionType
from regents_cosim.collisions import collision_type_of, first_contact
from regents_cosim.errors import DriveError
from regents_cosim.evaluation.drives.crash_verdict import (
    CaseEnd,
    CrashCounts,
    CrashVerdict,
    is_ordinary,
    verdict_of_drive,
)
from regents_cosim.evaluation.drives.safety import measure_drive
from regents_cosim.evaluation.statistics import mean_interval, wilson
from regents_cosim.geometry.boxes import Boxes
from regents_cosim.planners.controllers import PlannerControllers
from regents_cosim.planners.interface import DebugSteps
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S
from regents_cosim.planners.under_test import AnyPlanner, PlannerUnderTest
from regents_cosim.replays.mirror import MirrorController
from regents_cosim.replays.replay import Background, Simulator, check, replay_each
from regents_cosim.scenario import Kind, Scenario, Tracks
from regents_cosim.short_repr import ShortRepr
from regents_cosim.system.progress import logs_items
from regents_cosim.system.workers import in_turn
from regents_cosim.verdicts.judge import up_to_date
from regents_cosim.verdicts.law.drive import AgentDrive
from regents_cosim.verdicts.law.offences import against_direction, knows_lights, red_lights
from regents_cosim.verdicts.leaving_road import corners_off_road

# Metrics of an ego's drive, one short pure function each.
#
# Source: the scores of the CARLA leaderboard 1.0, which KING (Hanselmann et al. 2022) uses. Its page on evaluation,
# leaderboard.carla.org/evaluation_v1_0, lists the penalties: a collision with a pedestrian 0.50, with a vehicle 0.60, a
# red light 0.70, off-road driving by its share. Its code, `leaderboard/utils/statistics_manager.py`, multiplies by 1 -
# share, and `OutsideRouteLanesTest` of scenario_runner adds the distances off the road and in lanes of the wrong
# direction.
_RED_LIGHT = 0.7
_SAME_M = 0.05  # a vehicle this near to its log all the time replays it
_OFF_ROUTE_M = 4.0  # farther from its logged path, the ego is on another road


def route_completion(route: Float[np.ndarray, "point 2"], driven: Float[np.ndarray, "time 2"]) -> float:
    """The share of the logged `route` [m] that the positions `driven` [m] reach; 1 for a route without length.

    Positions more than 4 m off the route do not count, and neither does the way beyond its end.
    """
    line = shapely.LineString(route)
    if line.length == 0.0:
        return 1.0
    points = shapely.points(driven)
    along, away = np.asarray(shapely.line_locate_point(line, points)), np.asarray(shapely.distance(line, points))
    reached = along[away <= _OFF_ROUTE_M]
    return float(reached.max(initial=0.0) / line.length)


def share_of_way(driven: Float[np.ndarray, "time 2"], holds: Bool[np.ndarray, " time"]) -> float:
    """The share of the driven distance [m] on which something held, at the end of each step; 0 where it stood."""
    ways = np.hypot(*np.diff(driven, axis=0).T)
    total = ways.sum()
    return float((ways * holds[1:]).sum() / total) if total > 0.0 else 0.0


def infraction_score(hit: Kind | None, outside: float, red_lights: int = 0) -> float:
    """Product of penalties: 0.5 for hitting a pedestrian or cyclist, 0.6 for a vehicle; 0.7 for each red light run.

    The share `outside` of the distance that is not on allowed lanes (off the road, or against the direction) counts as
    1 - share, as in the leaderboard's `OutsideRouteLanesTest`.
    """
    penalty = 1.0 if hit is None else 0.5 if hit in ("pedestrian", "bicycle") else 0.6
    return penalty * _RED_LIGHT**red_lights * (1.0 - outside)


def driving_score(completion: float, infraction: float) -> float:
    """Completion times infraction score."""
    return completion * infraction


_AS_FAR = 0.8  # of a careful driver's progress in a harmless case


@dataclass(frozen=True, repr=False)
class DriveResult(ShortRepr):
    """The drive of one case, with its scores."""

    case: str
    source: str  # file that the traffic came from
    completion: float  # 0 to 1
    infraction: float
    score: float
    hits: str | None  # agent that the ego collides with
    step: int | None  # of the collision
    off_road: float  # share of the driven distance
    against_direction: float | None = None  # share in lanes of the other direction; None: no lanes are known
    red_lights: int | None = None  # number that it ran; None: the lights are not known
    collision_type: CollisionType | None = None
    act_s: tuple[float, ...] = ()  # duration of each decision of a planner outside the mirror
    error: str = ""  # message of a planner that failed, which counts as no progress
    trace: str = ""  # traceback of a planner that failed
    debug: DebugSteps = ()  # what a planner outside the mirror thought before its crash
    min_ttc_s: float | None = None  # surrogate safety: see `safety.Safety`
    min_pet_s: float | None = None
    max_drac_m_s2: float | None = None
    min_gap_m: float | None = None
    verdict: CrashVerdict | None = None  # on the crash; None where there is none, or it was not judged
    ordinary: bool = False  # the case has no attack
    telling_case: bool = False  # the attacked case has a telling crash, whatever this drive does
    careful_completion: float | None = None  # completion of a careful driver, in a harmless neighbour of a crash
    rear_ended: bool = False  # a follower that replays its log, and so cannot brake, drives into the ego's rear

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
    def end(self) -> CaseEnd:
        """The end of the drive, for counting."""
        return CaseEnd(self.hits is not None, self.ordinary, self.verdict, failed=bool(self.error))

    @property
    def held_up(self) -> bool:
        """Whether it gets less than 80 % as far as a careful driver in a harmless case."""
        return self.careful_completion is not None and self.completion < _AS_FAR * self.careful_completion


@dataclass(frozen=True, repr=False)
class DrivingRow(ShortRepr):
    """A planner's scores over cases, with 95 % intervals."""

    source: str
    n: int
    telling_collisions: int  # the planner's telling crashes
    flawless_collisions: int  # those of them whose adversary keeps every rule
    telling_unknown: int  # the planner's collisions for which that is unknown
    telling_cases: int  # cases whose attack ended in a telling crash, whatever this planner does
    harmless_cases: int  # harmless neighbours of crashes
    held_up: int  # harmless cases in which the planner gets less than 80 % as far as a careful driver
    route_completion_percent: float
    completion_interval_percent: tuple[float, float]
    collisions: int
    ordinary_collisions: int  # collisions without an attack
    rear_ended: int  # of the collisions, those in which a follower that replays its log drives into the ego's rear
    collision_rate_percent: float
    collision_interval_percent: tuple[float, float]
    infraction_score: float
    driving_score_percent: float
    driving_interval_percent: tuple[float, float]
    off_road_percent: float  # share of the driven distance
    against_direction_percent: float | None  # share of the driven distance, where lanes are known
    red_lights: int  # number that were run
    red_light_cases: int  # cases in which any was run
    lights_known: int  # cases in which lights are known
    planner_errors: int  # cases in which the planner failed, which count as no progress
    act_median_ms: float | None  # of planners outside the mirror
    act_p99_ms: float | None
    # 5th percentile over drives in which it is defined: the median of ordinary traffic says little about danger, and
    # the minimum is a single drive. A collision counts as 0 s.
    min_ttc_p5_s: float | None
    min_pet_p5_s: float | None
    max_drac_p95_m_s2: float | None


def _went(drive: DriveResult) -> str:
    """A drive's outcome, for the log."""
    hit = f"hits {drive.hits} at step {drive.step}" if drive.hits is not None else "no collision"
    return f"drove {drive.case}: {drive.error or hit}"


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
        with MirrorController(given, act_timeout_s) as driver:
            yield from in_turn(partial(drive_case, driver=driver), scenarios)
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


def drive_case(scenario: Scenario, driver: MirrorController) -> DriveResult:
    """Let the planner drive one case to the end of its horizon or its first collision."""
    return drive_and_keep(scenario, driver)[0]


def drive_and_keep(scenario: Scenario, driver: MirrorController) -> tuple[DriveResult, Tracks | None]:
    """The drive of one case as by `drive_case`, and the tracks of all agents; None where the planner failed."""
    try:
        driven = driver.drive(scenario)
    except DriveError as failure:
        return failed_drive(scenario, str(failure), failure.trace), None
    made = judged(scenario, driver.planner, driven.tracks)
    return replace(made, act_s=tuple(driven.act_seconds), debug=driven.debug), driven.tracks


def driving_rows(drives: Sequence[DriveResult]) -> list[DrivingRow]:
    """A row for each source of traffic, and one for all sources."""
    sources = sorted({drive.source for drive in drives})
    rows = [driving_row(source, [drive for drive in drives if drive.source == source]) for source in sources]
    return rows if len(rows) == 1 else [*rows, driving_row("all", drives)]


def driving_row(source: str, drives: Sequence[DriveResult]) -> DrivingRow:
    """The means and rates of some drives."""
    counts = CrashCounts.of(drive.end for drive in drives)
    act_s = [second for drive in drives for second in drive.act_s]
    median, p99 = (round(1e3 * float(v), 3) for v in np.percentile(act_s, [50, 99])) if act_s else (None, None)
    against = [drive.against_direction for drive in drives if drive.against_direction is not None]
    completions, scores = [drive.completion for drive in drives], [drive.score for drive in drives]
    return DrivingRow(
        source=source,
        n=len(drives),
        telling_collisions=counts.telling,
        flawless_collisions=counts.flawless,
        telling_unknown=counts.telling_unknown,
        telling_cases=sum(drive.telling_case for drive in drives),
        harmless_cases=sum(drive.careful_completion is not None for drive in drives),
        held_up=sum(drive.held_up for drive in drives),
        route_completion_percent=_percent(fmean(completions)),
        completion_interval_percent=_interval(mean_interval(completions)),
        collisions=counts.crashes,
        ordinary_collisions=counts.ordinary,
        rear_ended=sum(drive.rear_ended for drive in drives),
        collision_rate_percent=_percent(counts.crashes / len(drives)),
        collision_interval_percent=_interval(wilson(counts.crashes, len(drives))),
        infraction_score=round(fmean(drive.infraction for drive in drives), 3),
        driving_score_percent=_percent(fmean(scores)),
        driving_interval_percent=_interval(mean_interval(scores)),
        off_road_percent=_percent(fmean(drive.off_road for drive in drives)),
        against_direction_percent=_percent(fmean(against)) if against else None,
        red_lights=sum(drive.red_lights or 0 for drive in drives),
        red_light_cases=sum(bool(drive.red_lights) for drive in drives),
        lights_known=sum(drive.red_lights is not None for drive in drives),
        planner_errors=counts.failed,
        act_median_ms=median,
        act_p99_ms=p99,
        min_ttc_p5_s=_percentile([drive.min_ttc_s for drive in drives], 5),
        min_pet_p5_s=_percentile([drive.min_pet_s for drive in drives], 5),
        max_drac_p95_m_s2=_percentile([drive.max_drac_m_s2 for drive in drives], 95),
    )


def failed_drive(scenario: Scenario, error: str, trace: str = "") -> DriveResult:
    """The drive of a planner or simulator that failed."""
    return DriveResult(
        scenario.id, scenario.provenance.file, 0.0, 1.0, 0.0, None, None, 0.0,
        error=error, trace=trace, **_of_case(scenario),
    )  # fmt: skip


def score(scenario: Scenario, tracks: Tracks) -> DriveResult:
    """The scores of an ego that has driven along `tracks`, to the end of the horizon or its first collision."""
    contact = first_contact(scenario.agents, tracks)
    end = tracks.steps if contact is None else contact[1] + 1
    log = scenario.recorded_tracks
    driven = np.stack([tracks.x[0, :end], tracks.y[0, :end]], axis=-1)
    completion = route_completion(np.stack([log.x[0], log.y[0]], axis=-1), driven)
    ego = AgentDrive(scenario, 0, tracks, end - 1)
    off_road = _off_road(scenario, tracks)[:end]
    against = against_direction(ego) if scenario.road.lanes else None
    passed = len(red_lights(ego)) if knows_lights(scenario) else None
    outside = off_road if against is None else off_road | against
    kind = scenario.agents[contact[0]].kind if contact else None
    how = collision_type_of(scenario.agents, tracks, *contact) if contact else None
    infraction = infraction_score(kind, share_of_way(driven, outside), passed or 0)
    return DriveResult(
        case=scenario.id,
        source=scenario.provenance.file,
        completion=completion,
        infraction=infraction,
        score=driving_score(completion, infraction),
        hits=scenario.agents[contact[0]].id if contact else None,
        step=contact[1] if contact else None,
        off_road=share_of_way(driven, off_road),
        against_direction=None if against is None else share_of_way(driven, against),
        red_lights=passed,
        **asdict(measure_drive(scenario.agents, tracks, scenario.dt, contact[1] if contact else None)),
        collision_type=how,
        rear_ended=contact is not None and how == "rear_end_by_adversary" and _replays(scenario, tracks, *contact),
        **_of_case(scenario),
    )


def _replays(scenario: Scenario, tracks: Tracks, agent: int, step: int) -> bool:
    """Whether an agent that is no adversary has driven exactly as the case has it, up to a step."""
    until = np.s_[agent, : step + 1]
    away = np.hypot(tracks.x[until] - scenario.tracks.x[until], tracks.y[until] - scenario.tracks.y[until])
    return scenario.agents[agent].role != "adversary" and bool((away < _SAME_M).all())


def judged(scenario: Scenario, planner: str, tracks: Tracks) -> DriveResult:
    """The scores of `planner`, which has driven along `tracks`, with a verdict on its crash."""
    return replace(score(scenario, tracks), verdict=verdict_of_drive(scenario, planner, tracks))


def _of_case(scenario: Scenario) -> dict[str, Any]:
    """The fields of a drive that come from its case."""
    attack, judgement = scenario.attack, up_to_date(scenario).judgement
    return {
        "ordinary": is_ordinary(scenario),
        "telling_case": judgement is not None and judgement.telling is True,
        "careful_completion": attack.careful_completion if attack else None,
    }


def _off_road(scenario: Scenario, tracks: Tracks) -> Bool[np.ndarray, " time"]:
    """Whether a corner of the ego is more than 0.3 m off the road, at each step."""
    ego = scenario.ego
    size = np.float64(ego.length), np.float64(ego.width)
    box = Boxes(tracks.x[0], tracks.y[0], tracks.yaw[0], *size, tracks.z[0])
    return np.any(corners_off_road(scenario.road, box), axis=-1)


def _interval(bounds: tuple[float, float]) -> tuple[float, float]:
    """An interval in percent, clipped to 0 to 100."""
    return _percent(max(bounds[0], 0.0)), _percent(min(bounds[1], 1.0))


def _percent(share: float) -> float:
    return round(100.0 * share, 1)


def _percentile(values: Sequence[float | None], percent: int) -> float | None:
    defined = [value for value in values if value is not None]
    return round(float(np.percentile(defined, percent)), 2) if defined else None
