"""`python -m benchmarks logs`: how logs of every format are read, followed by the mirror, and attacked."""

import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, islice
from pathlib import Path
from typing import Literal

from benchmarks.reconstruction import reconstruction_row
from regents_cosim.attacks.methods.presets import OURS
from regents_cosim.benchmarks.runs import ComparedMethod, one_run
from regents_cosim.evaluation.crashes.failures import count_reasons
from regents_cosim.evaluation.crashes.scores import (
    Results,
    collided_before,
    count_windows,
    is_crash,
    is_flawless,
    is_telling,
)
from regents_cosim.norms.grades import Prevention
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.routes.route import route_of
from regents_cosim.scenario.judgement import Judgement
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.sources.logs.cut import LogWindows, cut
from regents_cosim.sources.logs.inspection import moving_centres, on_road
from regents_cosim.sources.logs.record import origin_of, scenes_of
from regents_cosim.sources.logs.roads.road import build_road
from regents_cosim.sources.logs.scene import LoggedScene
from regents_cosim.sources.windows import RecordingOrigin, Windows
from regents_cosim.system.progress import SILENT, Progress


@dataclass(frozen=True)
class LogRow:
    """The results of one format."""

    format: str
    scenes: int
    agents: int
    windows: int
    on_road_percent: float | None  # centres of moving vehicles on the drivable area
    on_road_on_map_percent: float | None  # of those within 10 m of a mapped lane
    smooth_mean_cm: float | None  # position error of the smooth fit
    smooth_p99_cm: float | None
    read_s: float  # per scene: from the file to its windows


@dataclass
class _Tally:
    """The counts of one format so far."""

    scenes: int = 0
    agents: int = 0
    centres: int = 0
    inside: float = 0.0
    near: int = 0
    near_inside: float = 0.0
    seconds: float = 0.0
    windows: list[Scenario] = field(default_factory=list)


def log_rows(paths: list[Path], count: int = 8, horizon_s: float = 8.0) -> Iterator[LogRow]:
    """A row for each format found at `paths`; up to `count` windows of each scene are fitted."""
    tallies: dict[str, _Tally] = defaultdict(_Tally)
    asked = LogWindows(Windows(count, 0, horizon_s))
    for path in paths:
        begin = time.perf_counter()
        for file, name, scene in scenes_of(path):
            tally = tallies[name]
            found = list(islice(cut(scene, asked, origin_of(file, name, scene), Counter()), count))
            tally.seconds += time.perf_counter() - begin
            tally.scenes += 1
            tally.agents += len(scene.tracks)
            tally.windows += found
            centres, _ = moving_centres(scene)
            _count(tally, len(centres), *on_road(build_road(scene), centres))
            begin = time.perf_counter()
    for name, tally in tallies.items():
        yield _row(name, tally)


def _count(tally: _Tally, centres: int, inside: float | None, near: float | None) -> None:
    if inside is not None:
        tally.centres += centres
        tally.inside += inside * centres
    if near is not None:
        tally.near += centres
        tally.near_inside += near * centres


def _row(name: str, tally: _Tally) -> LogRow:
    fit = reconstruction_row(name, tally.windows) if tally.windows else None
    return LogRow(
        format=name,
        scenes=tally.scenes,
        agents=tally.agents,
        windows=len(tally.windows),
        on_road_percent=_percent(tally.inside, tally.centres),
        on_road_on_map_percent=_percent(tally.near_inside, tally.near),
        smooth_mean_cm=round(fit.smooth_mean_cm, 2) if fit else None,
        smooth_p99_cm=round(fit.smooth_p99_cm, 2) if fit else None,
        read_s=round(tally.seconds / tally.scenes, 3),
    )


def _percent(part: float, whole: int) -> float | None:
    return round(100.0 * part / whole, 2) if whole else None


# --- attacked ---------------------------------------------------------------------------------


# Recordings, as provenances name them, that had a part in a choice: in how signs, crossings and unmapped ground are
# read and judged, and which windows are taken. All others are held out.
TUNED_ON = frozenset(
    {
        "0a1e6f0a-1817-4a98-b02e-db8c9327d151",
        "7fab2350-7eaf-3b7e-a39d-6937a4c1bede",
        "DEU_AachenBendplatz-1_90_T-300.xml",
        "USA_Peach-4_8_T-1.xml",
        "USA_US101-3_3_T-1.xml",
        "vehicle_tracks_000.csv",
        "sd_nuscenes_v1.0-mini_scene-0553.pkl",
        "sd_training.tfrecord-00000-of-01000_2a1e44d405a6833f.pkl",
        "motion_data_one_example.tfrecord",
        "motion_data_one_scenario.tfrecord",
        "tfrecord-00000-of-00150_2a173b334be3d32c.json.gz",
        "tfrecord-00000-of-00150_6d2a107f2e8390a.json.gz",
        "tfrecord-00000-of-00150_b065dcb23730589b.json.gz",
        "tfrecord-00000-of-01000_4.json.gz",
        "tfrecord-00031-of-01000_123.json.gz",
        "tfrecord-00069-of-01000_193.json.gz",
        "tfrecord-00077-of-01000_81.json.gz",
        "tfrecord-00095-of-01000_204.json.gz",
    }
)


@dataclass(frozen=True)
class LogCrashes:
    """What an attack finds in the windows of one format. All numbers are of windows."""

    format: str
    traffic: Literal["held out", "tuned on"]
    windows: int
    without_route: int  # windows in which no lanes lead the ego to its target
    n: int  # windows without a collision before the attack
    crashes: int  # windows with a crash, as in all that follow
    telling: int
    telling_percent: float | None
    flawless: int
    flawless_percent: float | None
    telling_unknown: int  # none is telling, and of one it is not known
    law_unknown: int  # clean, preventable, and not known whether the adversary keeps every rule
    why_unknown: dict[str, int]  # what the data of those does not tell
    spoilt: int  # not strictly clean
    why_spoilt: dict[str, int]  # their flaws
    failures: dict[str, int]  # reasons why no crash is telling


_DRAWS = 3  # of egos for each window wanted: some are drawn again
CRASHES = (
    "format",
    "traffic",
    "n",
    "telling_percent",
    "flawless_percent",
    "law_unknown",
    "spoilt",
    "without_route",
    "failures",
)


def logged_windows(
    paths: Sequence[Path], count: int = 8, seed: int = 0, horizon_s: float = 8.0
) -> dict[str, list[Scenario]]:
    """Windows by format: up to `count` of each scene, first those of its own ego, then those of egos drawn by seed."""
    found: dict[str, list[Scenario]] = defaultdict(list)
    for file, name, scene in chain.from_iterable(map(scenes_of, paths)):
        found[name] += _windows(scene, origin_of(file, name, scene), count, seed, horizon_s)
    return found


def _windows(scene: LoggedScene, origin: RecordingOrigin, count: int, seed: int, horizon_s: float) -> list[Scenario]:
    found: dict[tuple[float, str], Scenario] = {}
    without_ego = replace(scene, ego=None, target=None)
    for of, draw in ((scene, seed), *((without_ego, seed + k) for k in range(_DRAWS * count))):
        asked = LogWindows(Windows(count, draw, horizon_s))
        for window in islice(cut(of, asked, origin, Counter()), count - len(found)):
            found.setdefault((window.provenance.begin_s, window.ego.id), window)
    return list(found.values())


def crash_rows(
    windows: dict[str, list[Scenario]], planner: str = "idm", output: Path | None = None, progress: Progress = SILENT
) -> Iterator[LogCrashes]:
    """Rows for each format whose `windows` are attacked by our method, and for all of them: held out and tuned on."""
    given, ours = PlannerUnderTest.of(planner), ComparedMethod(OURS.method, OURS)
    every: list[Results] = []
    for name, found in windows.items():
        if found:
            here = one_run(found, given, ours, output, progress).windows
            every += here
            yield from crash_rows_of(name, here)
    yield from crash_rows_of("all", every)


def crash_rows_of(name: str, windows: Sequence[Results]) -> Iterator[LogCrashes]:
    """The row of attacked windows of recordings that are held out, and of those that are tuned on, where any are."""
    for tuned in (False, True):
        here = [results for results in windows if (results[0].provenance.file in TUNED_ON) is tuned]
        if here:
            yield _row_of_crashes(name, "tuned on" if tuned else "held out", here)


def _row_of_crashes(name: str, traffic: Literal["held out", "tuned on"], windows: Sequence[Results]) -> LogCrashes:
    judged = [results for results in windows if not collided_before(results)]
    nearest = [_nearest_to_flawless(results) for results in judged]
    unknown = [one for one in nearest if one and _law_unknown(one)]
    spoilt = [one for one in nearest if one and not one.clean]
    telling, flawless = (count_windows(judged, which) for which in (is_telling, is_flawless))
    return LogCrashes(
        format=name,
        traffic=traffic,
        windows=len(windows),
        without_route=sum(_without_route(results[0]) for results in windows),
        n=len(judged),
        crashes=count_windows(judged, is_crash),
        telling=telling,
        telling_percent=_percent(telling, len(judged)),
        flawless=flawless,
        flawless_percent=_percent(flawless, len(judged)),
        telling_unknown=sum(one is not None and one.telling is None for one in nearest),
        law_unknown=len(unknown),
        why_unknown=_counted(one.law.unknown if one.law and not one.guessed else ("heading",) for one in unknown),
        spoilt=len(spoilt),
        why_spoilt=_counted(one.flaws for one in spoilt),
        failures={str(reason): number for reason, number in count_reasons(judged).items() if number},
    )


def _nearest_to_flawless(results: Results) -> Judgement | None:
    order = {True: 2, None: 1, False: 0}
    crashes = [case.judgement for case in results if case.judgement]
    return max(crashes, key=lambda one: (order[one.telling], order[one.flawless], one.clean), default=None)


def _law_unknown(judgement: Judgement) -> bool:
    """Whether all is known of a crash that could be flawless but what the law says."""
    return judgement.clean and judgement.flawless is None and judgement.prevention is not Prevention.NOT_PREVENTABLE


def _without_route(window: Scenario) -> bool:
    return not route_of(window).by_lanes


def _counted(words: Iterable[Iterable[str]]) -> dict[str, int]:
    return dict(Counter(chain.from_iterable(words)).most_common())
