"""How much of the map of behaviours methods fill with the same number of roll-outs, seed by seed."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain, combinations
from pathlib import Path
from statistics import fmean

from benchmarks.quality_diversity import quality_diversity_run
from regents_cosim.attacks.methods.presets import OURS
from regents_cosim.benchmarks.runs import ComparedMethod, places_run, run_once
from regents_cosim.evaluation.crashes.scores import MethodRun, Results
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.runs.archive.axes import Axes
from regents_cosim.runs.archive.crash import crash_of
from regents_cosim.runs.archive.elites import Archive
from regents_cosim.runs.archive.illumination import METHOD, require_possible
from regents_cosim.scenario import Scenario
from regents_cosim.system.progress import SILENT, Progress

_MOST_PAIRS = 16  # 2^16 sign patterns


@dataclass(frozen=True)
class ArchiveRow:
    """The cells that one method fills with the traffic of one seed."""

    method: str
    seed: int
    windows: int
    rollouts: int  # made, in all windows
    crashes: int  # that SUMO confirms
    cells: int
    qd_score: float


@dataclass(frozen=True)
class ArchiveComparison:
    """The comparison of two methods on the same windows."""

    method: str
    than: str
    seeds: int
    cells: float  # mean of the first
    cells_than: float
    cells_p: float  # that both fill equally many (exact, paired)
    qd_score: float
    qd_score_than: float
    qd_score_p: float


def archive_rows(
    traffic: Sequence[tuple[int, Sequence[list[Scenario]]]],
    planner: PlannerUnderTest,
    methods: Sequence[ComparedMethod],
    axes: Axes,
    output: Path | None = None,
    progress: Progress = SILENT,
) -> Iterator[ArchiveRow]:
    """A row for each seed and method; `traffic`: seeds with their windows, place by place. `output` keeps the runs.

    The search of `--archive` gets, for every window, as many roll-outs as the first method made there, and its rules.
    """
    require_possible(OURS, planner)
    for seed, places in traffic:
        *_, runs = places_run(places, planner, methods, output, progress)
        for run in runs:
            yield archive_row(run, seed, axes)
        windows, made = list(chain(*places)), list(map(_made, runs[0].windows))
        config = methods[0].config
        assert config is not None
        settings = {"config": config.settings, "axes": list(axes.names), "rollouts": made, "seed": seed}
        make = partial(quality_diversity_run, windows, planner, config, axes, made, seed, progress)
        yield archive_row(run_once(output, METHOD, planner.name, settings, windows, make), seed, axes)


def archive_row(run: MethodRun, seed: int, axes: Axes) -> ArchiveRow:
    """The cells that a run fills with crashes that SUMO confirms."""
    confirmed = {one.case for one in run.in_sumo if one.verified}
    cases = [case for results in run.windows for case in results if case.id in confirmed]
    archive = Archive(axes, filter(None, map(crash_of, cases)))
    made = sum(map(_made, run.windows))
    return ArchiveRow(run.method, seed, len(run.windows), made, len(cases), len(archive.elites), archive.qd_score)


def _made(results: Results) -> int:
    """Roll-outs made in a window."""
    return results[0].attack.rollouts if results[0].attack else 0


def archive_comparisons(rows: Sequence[ArchiveRow]) -> list[ArchiveComparison]:
    """Each method against each that comes after it."""
    by_method: dict[str, list[ArchiveRow]] = {}
    for row in rows:
        by_method.setdefault(row.method, []).append(row)
    return [_comparison(*one, *other) for one, other in combinations(by_method.items(), 2)]


def _comparison(first: str, its: Sequence[ArchiveRow], other: str, theirs: Sequence[ArchiveRow]) -> ArchiveComparison:
    cells, cells_than = [float(row.cells) for row in its], [float(row.cells) for row in theirs]
    score, score_than = [row.qd_score for row in its], [row.qd_score for row in theirs]
    return ArchiveComparison(
        method=first,
        than=other,
        seeds=len(its),
        cells=round(fmean(cells), 2),
        cells_than=round(fmean(cells_than), 2),
        cells_p=paired_p(cells, cells_than),
        qd_score=round(fmean(score), 2),
        qd_score_than=round(fmean(score_than), 2),
        qd_score_p=paired_p(score, score_than),
    )


def paired_p(first: Sequence[float], second: Sequence[float]) -> float:
    """P value of the hypothesis that the differences of pairs have random signs; at most 16 pairs.

    Source: Fisher 1935, "The Design of Experiments", section 21, in its exact form, over all sign patterns.
    """
    differences = [a - b for a, b in zip(first, second, strict=True)]
    if len(differences) > _MOST_PAIRS:
        raise ValueError(f"{len(differences)} pairs, expected at most {_MOST_PAIRS}")
    least = abs(sum(differences)) - 1e-9
    sums = [0.0]
    for difference in differences:
        sums = [total + sign * difference for total in sums for sign in (1.0, -1.0)]
    return sum(abs(total) >= least for total in sums) / len(sums)
