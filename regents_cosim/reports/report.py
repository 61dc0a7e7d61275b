"""`regents report`: collects cases, drives and scores for the page."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import tee
from pathlib import Path
from statistics import median
from types import MappingProxyType
from typing import Any

import numpy as np
from jaxtyping import Float

from regents_cosim.cases.manifest import MANIFEST
from regents_cosim.cases.provenance import command
from regents_cosim.cases.suite import cases_in_turn
from regents_cosim.checks.arguments import as_several
from regents_cosim.checks.names import require_distinct
from regents_cosim.errors import RegentsError
from regents_cosim.evaluation.crashes.realism import motion, pooled
from regents_cosim.evaluation.drives.crash_verdict import CrashCounts, contact_of, end_of_case, verdict_of_drive
from regents_cosim.evaluation.drives.driving import (
    COLUMNS,
    DriveResult,
    DriveWithTracks,
    DrivingRow,
    drive_in_mirror,
    driving_row,
)
from regents_cosim.evaluation.drives.metrics import Column
from regents_cosim.evaluation.drives.safety import Safety, measure_drive
from regents_cosim.evaluation.statistics import wilson
from regents_cosim.norms.limits import MOST_ACCEL_M_S2
from regents_cosim.plain_text import all_named, counted
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S
from regents_cosim.planners.under_test import AnyPlanner, PlannerUnderTest
from regents_cosim.reports.page.case import MotionRow, PageCase, PageDrive, PageEntry
from regents_cosim.reports.page.html import Report, Score, html_page, json_twin
from regents_cosim.reports.page.map import PageMap, PageMaps
from regents_cosim.scenario.scenario import Scenario, Tracks
from regents_cosim.system.files.output_files import require_output, write_output_file
from regents_cosim.system.workers import in_turn
from regents_cosim.verdicts.judge import judge, up_to_date
from regents_cosim.verdicts.words import kmh

# Fields of `MotionSamples`: their words, their units, and the limit of a car on a dry road.
_MOTIONS = {
    "accel": ("Acceleration", "m/s²", MOST_ACCEL_M_S2),
    "lateral": ("Lateral acceleration", "m/s²", MOST_ACCEL_M_S2),
    "jerk": ("Jerk", "m/s³", 15.0),
    "yaw_rate": ("Yaw rate", "rad/s", 0.8),
}

Watch = Callable[[Iterator[PageEntry]], Iterable[PageEntry]]

_MOST_PLANNERS = 2
_MOST_NAMED = 8  # most networks named in the subtitle


def report(cases: Path | str | Sequence[Scenario], path: Path | str, planners: Sequence[AnyPlanner] = ()) -> None:
    """Write one HTML file that shows `cases` (a folder, or in memory), and NAME.report.json beside it for programs.

    `planners`, one or two: the first drives the ego among the adversaries of each case, a second one is compared with
    it. Without them the page shows the drives that the cases hold. Raises RegentsError where a file cannot be read or
    written, PlannerError where a planner cannot be found.
    """
    given = [PlannerUnderTest.of(planner) for planner in as_several(planners)]
    check_report(Path(path), [planner.name for planner in given])
    folder = Path(cases) if isinstance(cases, (str, Path)) else None
    scenarios, driven = judged_and_driven(cases_in_turn(cases), given)
    save_report(report_of(scenarios, driven, folder), Path(path))


def check_report(path: Path, planners: Sequence[str]) -> None:
    """Raise RegentsError now for what would fail at the end: a path that cannot be written, or planners to compare."""
    if path.suffix != ".html":
        raise RegentsError(f"--output {path}: expected a name that ends in .html")
    for one in (path, twin_of(path)):
        require_output(one)
    if len(planners) > _MOST_PLANNERS or len(set(planners)) < len(planners):
        raise RegentsError(f"--planner {', '.join(planners)}: expected one planner, or two different ones to compare")


def judge_rest(scenarios: Iterable[Scenario]) -> Iterator[Scenario]:
    """Judge the crashes that have not been judged, in order."""
    return in_turn(lambda case: case if case.judgement else judge(case), scenarios)


def judged_and_driven(
    scenarios: Iterable[Scenario], planners: Sequence[PlannerUnderTest], act_timeout_s: float = ACT_TIMEOUT_S
) -> tuple[Iterator[Scenario], dict[str, Iterator[DriveWithTracks]]]:
    """The cases and the drives of each planner, to be iterated in parallel: each case is loaded and judged once."""
    judged, *others = tee(judge_rest(scenarios), 1 + len(planners))
    return judged, {
        one.name: drive_in_mirror(its, one, act_timeout_s) for one, its in zip(planners, others, strict=True)
    }


def report_of(
    scenarios: Iterable[Scenario],
    driven: Mapping[str, Iterable[DriveWithTracks]],
    folder: Path | None = None,
    tags: Mapping[str, tuple[str, ...]] = MappingProxyType({}),
    watch: Watch = lambda entries: entries,
) -> Report:
    """The content of the page: the drives of each planner in `driven`, or those that the cases hold.

    Cases are read one by one and packed; none is kept in memory. `tags` has the known tags by case; `watch` wraps the
    iterator over packed cases.
    """
    maps, drives = PageMaps(), {name: list[DriveResult]() for name in driven}
    jobs = _jobs(scenarios, driven, drives, maps)
    pack = partial(_packed, folder=None if folder is None else _suite_of(folder), driven=bool(driven), tags=tags)
    cases = tuple(watch(in_turn(pack, jobs)))
    _check_cases(cases)
    attacked = sorted({case.attack.planner for case in cases if case.attack})
    drivers: tuple[str, ...] = tuple(driven) if driven else (all_named(attacked) or "log",)
    counts = {name: CrashCounts.of(case.runs[run].end for case in cases) for run, name in enumerate(drivers)}
    scores = _driving_scores(drives, counts) if driven else _attack_scores(drivers[0], cases, counts[drivers[0]])
    return Report(
        title=_title(drivers, bool(driven), bool(attacked)),
        subtitle=_subtitle(cases),
        drivers=drivers,
        driven=bool(driven),
        counts=counts,
        scores=tuple(scores),
        cases=cases,
        maps=tuple(maps.maps),
        command=command(),
    )


# A case to be packed, its drives by planner (where there are none, the case's own is shown), and its map.
_Job = tuple[Scenario, dict[str, DriveWithTracks], PageMap]


def _jobs(
    scenarios: Iterable[Scenario],
    driven: Mapping[str, Iterable[DriveWithTracks]],
    drives: Mapping[str, list[DriveResult]],
    maps: PageMaps,
) -> Iterator[_Job]:
    """One job for each case; the results of the planners are added to `drives`."""
    for scenario, *made in zip(scenarios, *driven.values(), strict=True):
        for its, (drive, _) in zip(drives.values(), made, strict=True):
            its.append(drive)
        yield scenario, dict(zip(driven, made, strict=True)), maps.home(scenario)


def _packed(job: _Job, folder: Path | None, driven: bool, tags: Mapping[str, tuple[str, ...]]) -> PageEntry:
    scenario, drives, home = job
    case = up_to_date(scenario)
    page_case = PageCase(case, _runs(case, drives), motion_sheet(case))
    return page_case.entry(home, folder, driven, tags.get(case.id))


def _suite_of(folder: Path) -> Path:
    return folder if (folder / MANIFEST).exists() else folder.parent


def save_report(made: Report, path: Path) -> None:
    """Write the page to `path` (.html), and the scores and the table to NAME.report.json beside it."""
    write_output_file(path, html_page(made).encode())
    write_output_file(twin_of(path), json_twin(made))


def twin_of(page: Path) -> Path:
    """The path of a page's scores and table as JSON; never the file name of a suite or a case."""
    return page.with_suffix(".report.json")


def _check_cases(cases: Sequence[PageEntry]) -> None:
    if not cases:
        raise RegentsError("no cases to report (make some with `regents attack`)")
    require_distinct(case.id for case in cases)


def _runs(scenario: Scenario, drives: Mapping[str, DriveWithTracks]) -> tuple[PageDrive, ...]:
    if drives:
        return tuple(_driven_run(name, *made) for name, made in drives.items())
    tracks, attack = scenario.tracks, scenario.attack
    contact = contact_of(scenario)
    closest = _closest(measure_drive(scenario.agents, tracks, scenario.dt, contact[1] if contact else None))
    name, error = (attack.planner, attack.planner_error) if attack else ("log", "")
    end = end_of_case(scenario)
    if end.crashed and end.verdict is None:  # a crash without an attack is judged like that of a drive
        end = replace(end, verdict=verdict_of_drive(scenario, name, tracks))
    return (PageDrive(name, tracks, error, closest, end),)


def _driven_run(name: str, drive: DriveResult, tracks: Tracks | None) -> PageDrive:
    if tracks is None:
        return PageDrive(name, None, drive.error, end=drive.end)
    return PageDrive(name, tracks, drive.error, _closest(drive), drive.end, drive.debug)


def _closest(found: DriveResult | Safety) -> dict[str, float | None]:
    values = {"ttc_s": found.min_ttc_s, "pet_s": found.min_pet_s}
    values |= {"drac_m_s2": found.max_drac_m_s2, "gap_m": found.min_gap_m}
    return {name: value and round(value, 2) for name, value in values.items()}


def motion_sheet(scenario: Scenario) -> tuple[MotionRow, ...]:
    """How the adversary moves before and after the attack, compared with the traffic; empty where it hardly moves."""
    agent = scenario.adversary
    if agent is None or scenario.log is None or scenario.attack is None:
        return ()
    hit, log, dt = scenario.attack.collision, scenario.log, scenario.dt
    end = hit.step + 1 if hit else None
    after, before = motion(scenario.tracks, agent, dt, end), motion(log, agent, dt, end)
    if not len(after.jerk) or not len(before.jerk):
        return ()
    traffic = pooled([motion(log, i, dt) for i in range(1, len(scenario.agents))])
    rows = []
    for key, (name, unit, limit) in _MOTIONS.items():
        was, now, others = (_most(getattr(one, key)) for one in (before, after, traffic))
        beyond = 100.0 * float((np.abs(getattr(after, key)) > limit).mean())
        rows.append(MotionRow(name, unit, was, now, others, round(limit, 1), round(beyond, 1)))
    return tuple(rows)


def _most(values: Float[np.ndarray, " sample"]) -> tuple[float, float]:
    """The range without the lowest and the highest twentieth."""
    low, high = np.percentile(values, (5, 95)).tolist()
    return round(low, 2), round(high, 2)


def _title(drivers: tuple[str, ...], driven: bool, attacked: bool) -> str:
    first, *others = drivers
    if others:
        return f"{others[0]} compared with {first}"
    if driven:
        return f"{first} among adversaries" if attacked else f"{first} in recorded traffic"
    return f"{first} under attack" if attacked else "Recorded traffic"


def _subtitle(cases: Sequence[PageEntry]) -> str:
    places = sorted({case.network for case in cases})
    of_sumo = all(case.of_sumo for case in cases)
    where = counted(len(places), "network" if of_sumo else "recording")
    named = f": {', '.join(places)}" if len(places) <= _MOST_NAMED else ""
    methods = sorted({case.attack.method for case in cases if case.attack})
    how = f" Attacked by {all_named(methods)}." if methods else ""
    return f"{counted(len(cases), 'case')} on {where}{named}.{how}"


# --- scores -----------------------------------------------------------------------------------


def _driving_scores(drives: Mapping[str, Sequence[DriveResult]], counts: Mapping[str, CrashCounts]) -> list[Score]:
    """The crashes of each driver by their verdicts, then the scores of `regents evaluate`."""
    rows = {name: driving_row("all", its) for name, its in drives.items()}
    crashes = [score for name, found in counts.items() for score in _crash_scores(name, found, counts.values())]
    return [*crashes, *(score for name, row in rows.items() for score in _scores_of(name, row))]


def _scores_of(name: str, row: DrivingRow) -> list[Score]:
    """Those columns of the row that are scores and known: the shares, then the counts that are not zero."""
    values = row.row() | {"cases": counted(row.n, "case")}
    known = [one for one in COLUMNS if one.label and values[one.name] is not None]
    shown = [one for one in known if one.interval or values[one.name]]
    return [_score(name, one, values) for one in sorted(shown, key=lambda one: not one.interval)]


def _score(driver: str, column: Column, values: Mapping[str, Any]) -> Score:
    value, ends = values[column.name], values.get(column.interval)
    share, interval = (value / 100, (ends[0] / 100, ends[1] / 100)) if ends else (None, None)
    return Score(column.label, driver, column.text.format(value), column.detail.format(**values), share, interval)


def _attack_scores(planner: str, cases: Sequence[PageEntry], found: CrashCounts) -> list[Score]:
    scores = [*_crash_scores(planner, found, [found]), _share("Crashes", planner, found.crashes, found.cases, "case")]
    if found.judged:
        scores.append(_share("Clean crashes", planner, found.clean, found.cases, "case"))
        scores.append(_share("Preventable", planner, found.preventable, found.judged, "crash"))
    impacts = [hit.relative_speed for case in cases if (hit := case.endings[0])]
    if impacts:
        spread = f"median; {3.6 * min(impacts):.0f} to {kmh(max(impacts))}"
        scores.append(Score("Impact speed", planner, kmh(median(impacts)), spread))
    return scores


def _crash_scores(driver: str, found: CrashCounts, of_all: Collection[CrashCounts]) -> list[Score]:
    """The main scores: crashes without an attack, and telling crashes, where one of the drivers has any."""
    scores = []
    if any(one.ordinary for one in of_all):
        scores.append(_share("Crashes without an attack", driver, found.ordinary, found.cases, "case"))
    if any(one.judged for one in of_all):
        score = _share("Telling crashes", driver, found.telling, found.cases, "case")
        unknown = f", not known of {found.telling_unknown}" if found.telling_unknown else ""
        scores.append(replace(score, detail=score.detail + unknown))
        scores.append(_share("Flawless crashes", driver, found.flawless, found.cases, "case"))
    return scores


def _share(label: str, planner: str, some: int, n: int, of: str) -> Score:
    return Score(label, planner, f"{100 * some / n:.0f} %", f"{some} of {counted(n, of)}", some / n, wilson(some, n))
