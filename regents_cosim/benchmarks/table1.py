"""`regents bench table1`: the results table of the ReGentS paper on one's own traffic, and what it does not measure.

Columns are methods, rows their scores. The paper's table has the first six rows: 200 windows, of which the planner
survives n; KING 90 and ReGentS 73 crashes of n = 149 (Yin et al. 2024, Table 1).
"""

import dataclasses
import itertools
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import PurePath

from regents_cosim.errors import RegentsError
from regents_cosim.evaluation.crashes.scores import COUNTS, MethodRun, MethodScores, Results, collided_before, scores
from regents_cosim.evaluation.statistics import mcnemar
from regents_cosim.scenario import Scenario

ALL, TUNED_ON, HELD_OUT = "all", "tuned on", "held out"


@dataclass(frozen=True)
class MethodComparison:
    """Two methods on the same windows: which of them succeed in one and not in the other, and McNemar's p."""

    planner: str
    places: str  # all, or those tuned on, or those held out
    first: str
    second: str
    count: str  # telling, flawless, success or clean
    only_first: int
    only_second: int
    p: float | None  # None: they searched by different protocols, and a p-value would compare these


@dataclass(frozen=True)
class Table1:
    """All there is to say about some runs."""

    scores: tuple[MethodScores, ...]
    by_use: tuple[MethodScores, ...]  # of the places that the methods were tuned on, and of those held out
    by_source: tuple[MethodScores, ...]
    comparisons: tuple[MethodComparison, ...]


def table1(runs: Sequence[MethodRun], tuned_on: Sequence[str] = ()) -> Table1:
    """Scores of every run, of all windows and source by source, and every pair of methods compared.

    `tuned_on` names the places that were used to choose settings of the methods; all others are held out.
    """
    sources = sorted({_file(results) for run in runs for results in run.windows})
    groups = _by_use(sources, tuned_on)
    return Table1(
        scores=tuple(scores(run) for run in runs),
        by_use=tuple(scores(run, use, files) for run in runs for use, files in groups.items()),
        by_source=tuple(scores(run, source, {source}) for run in runs for source in sources),
        comparisons=tuple(
            compare(first, second, count, places, files)
            for first, second in itertools.combinations(runs, 2)
            if first.planner == second.planner
            for places, files in ({ALL: None} | groups).items()
            for count in COUNTS
        ),
    )


def require_places(windows: Sequence[Scenario], tuned_on: Sequence[str]) -> None:
    """Raise RegentsError where one of the names of `tuned_on` is of no place that the windows are from."""
    files = sorted({window.provenance.file for window in windows})
    for name in tuned_on:
        if not any(_is_called(file, name) for file in files):
            shown = ", ".join(files[:8]) + (", ..." if len(files) > 8 else "")
            raise RegentsError(f"--tuned-on {name}: no window is from there (expected some of {shown})")


def _by_use(sources: Sequence[str], tuned_on: Sequence[str]) -> dict[str, set[str]]:
    """The files tuned on and those held out, where there are any; nothing where none is named."""
    if not tuned_on:
        return {}
    tuned = {file for file in sources if any(_is_called(file, name) for name in tuned_on)}
    groups = {TUNED_ON: tuned, HELD_OUT: set(sources) - tuned}
    return {use: files for use, files in groups.items() if files}


def _is_called(file: str, name: str) -> bool:
    """Whether a place goes by a name: its file, with or without its ending, * and ? standing for letters."""
    return any(fnmatchcase(one, name) for one in (file, PurePath(file).stem, file.partition(".")[0]))


def _file(results: Results) -> str:
    return results[0].provenance.file


def compare(
    first: MethodRun, second: MethodRun, count: str, places: str = ALL, files: Collection[str] | None = None
) -> MethodComparison:
    """Two runs on the same windows, over those in which the planner does not collide before the attack."""
    pairs = [
        tuple(any(map(COUNTS[count], results)) for results in both)
        for both in zip(first.windows, second.windows, strict=True)
        if not any(map(collided_before, both)) and (files is None or _file(both[0]) in files)
    ]
    mine, theirs = [a for a, _ in pairs], [b for _, b in pairs]
    return MethodComparison(
        planner=first.planner,
        places=places,
        first=first.method,
        second=second.method,
        count=count,
        only_first=sum(a and not b for a, b in pairs),
        only_second=sum(b and not a for a, b in pairs),
        p=mcnemar(mine, theirs) if first.protocol == second.protocol else None,
    )


def as_json(table: Table1) -> dict[str, object]:
    """The same as plain values, with a schema number."""
    return {"schema": 6, **dataclasses.asdict(table)}
