"""`regents bench table1`: the results table of the ReGentS paper on one's own traffic, and what it does not measure.

Columns are methods, rows their scores. The paper's table has the first six rows: 200 windows, of which the planner
survives n; KING 90 and ReGentS 73 crashes of n = 149 (Yin et al. 2024, Table 1).
"""

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from regents_cosim.evaluation.scores import (
    MethodScores,
    Run,
    collided_before,
    is_actionable,
    is_clean,
    is_crash,
    scores,
)
from regents_cosim.evaluation.statistics import mcnemar
from regents_cosim.scenario import Scenario

_COUNTS: dict[str, Callable[[Scenario], bool]] = {"success": is_crash, "clean": is_clean, "actionable": is_actionable}


@dataclass(frozen=True)
class Comparison:
    """Two methods on the same windows: which of them succeed in one and not in the other, and McNemar's p."""

    planner: str
    first: str
    second: str
    count: str  # success, clean or actionable
    only_first: int
    only_second: int
    p: float


@dataclass(frozen=True)
class Table1:
    """All there is to say about some runs."""

    scores: tuple[MethodScores, ...]
    by_source: tuple[MethodScores, ...]
    comparisons: tuple[Comparison, ...]


def table1(runs: Sequence[Run]) -> Table1:
    """Scores of every run, of all windows and source by source, and every pair of methods compared."""
    sources = sorted({results[0].provenance.file for run in runs for results in run.windows})
    return Table1(
        scores=tuple(scores(run) for run in runs),
        by_source=tuple(scores(run, source) for run in runs for source in sources),
        comparisons=tuple(
            compare(first, second, count)
            for first, second in itertools.combinations(runs, 2)
            if first.planner == second.planner
            for count in _COUNTS
        ),
    )


def compare(first: Run, second: Run, count: str) -> Comparison:
    """Two runs on the same windows, over those in which the planner does not collide before the attack."""
    pairs = [
        tuple(any(map(_COUNTS[count], results)) for results in both)
        for both in zip(first.windows, second.windows, strict=True)
        if not any(map(collided_before, both))
    ]
    mine, theirs = [a for a, _ in pairs], [b for _, b in pairs]
    return Comparison(
        planner=first.planner,
        first=first.method,
        second=second.method,
        count=count,
        only_first=sum(a and not b for a, b in pairs),
        only_second=sum(b and not a for a, b in pairs),
        p=mcnemar(mine, theirs),
    )


@dataclass(frozen=True)
class Section:
    """A grid of the table, and what stands above it."""

    title: str
    head: tuple[str, ...]
    cells: list[list[str]]

    def rows(self) -> list[dict[str, str]]:
        """By headings, without the marks that make text bold."""
        return [dict(zip(self.head, (cell.strip("*") for cell in row), strict=True)) for row in self.cells]


def sections(table: Table1) -> list[Section]:
    """The table as people read it: a column for each method, planner by planner."""
    found = []
    for planner in dict.fromkeys(one.planner for one in table.scores):
        columns = [one for one in table.scores if one.planner == planner]
        pairs = [one for one in table.comparisons if one.planner == planner]
        methods = [one.method for one in columns]
        found += [
            Section(f"### {planner}", ("", *methods), _rows(columns)),
            Section(
                "Windows in which just one of two methods succeeds, and McNemar's p:",
                ("", "success", "clean", "actionable"),
                _compared(pairs),
            ),
            Section(
                "By source, windows with a crash / clean / actionable:",
                ("", "n", *methods),
                _per_source(table, planner, columns),
            ),
        ]
    return found


def markdown(table: Table1) -> str:
    """The sections as Markdown."""
    parts = ([part.title, "", *_grid(part.head, part.cells), ""] for part in sections(table))
    return "\n".join(itertools.chain.from_iterable(parts))


def as_json(table: Table1) -> dict[str, object]:
    """The same as plain values, with a schema number."""
    return {"schema": 1, **dataclasses.asdict(table)}


def _grid(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows)]


def _rows(columns: Sequence[MethodScores]) -> list[list[str]]:
    rows: dict[str, Callable[[MethodScores], str]] = {
        "route completion": lambda c: f"{c.route_completion_percent} %",
        "infraction score": lambda c: f"{c.infraction_score:.2f}",
        "driving score": lambda c: f"{c.driving_score_percent} %",
        "collision rate": lambda c: f"{c.collision_rate_percent} %",
        "collide before the attack": lambda c: f"{c.colliding_before} of {c.windows}",
        "**success**": lambda c: _share(c.successes, c.n, c.success_percent, c.success_interval),
        "**clean success**": lambda c: _share(c.clean, c.n, c.clean_percent, c.clean_interval),
        "**actionable success**": lambda c: _share(c.actionable, c.n, c.actionable_percent, c.actionable_interval),
        "crashes found": lambda c: f"{c.crashes}",
        "not attributed": lambda c: f"{c.unattributed_percent} %",
        "ego rear-ended": lambda c: f"{c.rear_end_percent} %",
        "ego stands": lambda c: f"{c.standing_percent} %",
        "adversary off the road": lambda c: f"{c.off_road_percent} %",
        "adversary hits others": lambda c: f"{c.hits_others_percent} %",
        "avoidable": lambda c: f"{c.avoidable_percent} %",
        "avoidable in time": lambda c: f"{c.avoidable_in_time_percent} %",
        "last evasion before contact": lambda c: _unit(c.evade_before_s, "s"),
        "kinds": lambda c: ", ".join(f"{n} {kind.replace('_', ' ')}" for kind, n in sorted(c.kinds.items())) or "-",
        "impact": lambda c: _unit(c.impact_m_s, "m/s"),
        "at fault": lambda c: ", ".join(f"{who} {n}" for who, n in sorted(c.at_fault.items())) or "-",
        "deviation": lambda c: _unit(c.deviation_m, "m"),
        "distance to traffic": lambda c: ", ".join(f"{q} {d:g}" for q, d in c.realism_distance.items()) or "-",
        "in SUMO the same": lambda c: f"{c.verified_in_sumo}",
        "windows without an actionable crash": lambda c: _reasons(c),
        "rollouts at most": lambda c: f"{c.rollouts}",
        "time": lambda c: f"{c.seconds:.0f} s",
    }
    return [[name, *(show(column) for column in columns)] for name, show in rows.items()]


def _compared(pairs: Sequence[Comparison]) -> list[list[str]]:
    found: dict[str, dict[str, str]] = {}
    for pair in pairs:
        cell = f"{pair.only_first} : {pair.only_second}, p = {pair.p:.2g}"
        found.setdefault(f"{pair.first} : {pair.second}", {})[pair.count] = cell
    return [[name, *(cells[count] for count in _COUNTS)] for name, cells in found.items()]


def _per_source(table: Table1, planner: str, columns: Sequence[MethodScores]) -> list[list[str]]:
    rows = []
    of_planner = [found for found in table.by_source if found.planner == planner]
    for source in dict.fromkeys(found.source for found in of_planner):
        cells = {c.method: c for c in of_planner if c.source == source}
        counts = ((cells[c.method].successes, cells[c.method].clean, cells[c.method].actionable) for c in columns)
        shown = [" / ".join(map(str, three)) for three in counts]
        rows.append([source, str(max(c.n for c in cells.values())), *shown])
    return rows


def _reasons(found: MethodScores) -> str:
    return ", ".join(f"{n} {reason.replace('_', ' ')}" for reason, n in found.failures.items() if n) or "-"


def _share(part: int, n: int, percent: float, bounds: tuple[float, float]) -> str:
    return f"{part} of {n}: {percent:.0f} % ({bounds[0]:.0f} to {bounds[1]:.0f})"


def _unit(value: float | None, unit: str) -> str:
    return "-" if value is None else f"{value} {unit}"
