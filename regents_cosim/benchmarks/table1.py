"""`regents bench table1`: the results table of the ReGentS paper on one's own traffic, and what it does not measure.

Columns are methods, rows their scores. The paper's table has the first six rows: 200 windows, of which the planner
survives n; KING 90 and ReGentS 73 crashes of n = 149 (Yin et al. 2024, Table 1).
"""

import dataclasses
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from regents_cosim.evaluation.crashes.scores import COUNTS, MethodRun, MethodScores, Results, collided_before, scores
from regents_cosim.evaluation.statistics import mcnemar
from regents_cosim.system.data_frames import Tabular


@dataclass(frozen=True)
class MethodComparison:
    """Two methods on the same windows: which of them succeed in one and not in the other, and McNemar's p."""

    planner: str
    first: str
    second: str
    count: str  # telling, flawless, success or clean
    only_first: int
    only_second: int
    p: float | None  # None: they searched by different protocols, and a p-value would compare these


@dataclass(frozen=True)
class Table1(Tabular):
    """All there is to say about some runs; a data frame has `scores`."""

    scores: tuple[MethodScores, ...]
    by_source: tuple[MethodScores, ...]
    comparisons: tuple[MethodComparison, ...]

    def to_dict(self) -> dict[str, Any]:
        """All as plain values, with a schema number."""
        return {"schema": 7, **dataclasses.asdict(self)}

    def _rows(self) -> list[dict[str, Any]]:
        return self.to_dict()["scores"]


def table1(runs: Sequence[MethodRun]) -> Table1:
    """Scores of every run, of all windows and source by source, and every pair of methods compared."""
    sources = sorted({_file(results) for run in runs for results in run.windows})
    return Table1(
        scores=tuple(scores(run) for run in runs),
        by_source=tuple(scores(run, source, {source}) for run in runs for source in sources),
        comparisons=tuple(
            compare(first, second, count)
            for first, second in itertools.combinations(runs, 2)
            if first.planner == second.planner
            for count in COUNTS
        ),
    )


def _file(results: Results) -> str:
    return results[0].provenance.file


def compare(first: MethodRun, second: MethodRun, count: str) -> MethodComparison:
    """Two runs on the same windows, over those in which the planner does not collide before the attack."""
    pairs = [
        tuple(any(map(COUNTS[count], results)) for results in both)
        for both in zip(first.windows, second.windows, strict=True)
        if not any(map(collided_before, both))
    ]
    mine, theirs = [a for a, _ in pairs], [b for _, b in pairs]
    return MethodComparison(
        planner=first.planner,
        first=first.method,
        second=second.method,
        count=count,
        only_first=sum(a and not b for a, b in pairs),
        only_second=sum(b and not a for a, b in pairs),
        p=mcnemar(mine, theirs) if first.protocol == second.protocol else None,
    )
