"""The results table as people read it: a column for each method, planner by planner."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import get_args

from regents_cosim.benchmarks.table1 import MethodComparison, Table1
from regents_cosim.evaluation.crashes.scores import COUNTS, MethodScores
from regents_cosim.evaluation.statistics import percent
from regents_cosim.norms.grades import GROSS_OFFENCES, OFFENCES_ON_FOOT, Conduct, OffenceName, Prevention
from regents_cosim.scenario.judgement import OF_PERSONS, Flaw


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
        methods = [one.method for one in columns]
        found += [
            Section(f"### {planner}", ("", *methods), _rows(columns)),
            Section("Crashes by what the road users did against the law:", ("", *methods), _offences(columns)),
            Section(_BY_USUAL, ("at least", *methods), _by_usual(columns)),
            *_comparisons(table, planner),
            Section(
                "By source, windows with a telling crash / a flawless one / a crash / clean:",
                ("", "n", *methods),
                _grouped([one for one in table.by_source if one.planner == planner], methods, _counts),
            ),
        ]
    return found


def markdown(table: Table1) -> str:
    """The sections as Markdown."""
    parts = ([part.title, "", *_grid(part.head, part.cells), ""] for part in sections(table))
    return "\n".join(itertools.chain.from_iterable(parts))


def _grid(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows)]


def _rows(columns: Sequence[MethodScores]) -> list[list[str]]:
    rows: dict[str, Callable[[MethodScores], str]] = {
        "**telling success**": lambda c: f"**{_telling(c)}**",
        "**flawless success**": lambda c: f"**{_share(c.flawless, c.n, c.flawless_percent, c.flawless_interval)}**",
        "route completion": lambda c: f"{c.route_completion_percent} %",
        "infraction score": lambda c: f"{c.infraction_score:.2f}",
        "driving score": lambda c: f"{c.driving_score_percent} %",
        "collision rate": lambda c: f"{c.collision_rate_percent} %",
        "red lights run by the ego": _red_lights,
        "ego against the direction": lambda c: _unit(c.against_direction_percent, "% of its way"),
        "collide before the attack": lambda c: f"{c.colliding_before} of {c.windows}",
        "success": lambda c: _share(c.successes, c.n, c.success_percent, c.success_interval),
        "clean success": lambda c: _share(c.clean, c.n, c.clean_percent, c.clean_interval),
        "crashes found": lambda c: f"{c.crashes}",
        **{flaw.heading: _flawed(flaw) for flaw in Flaw if flaw not in OF_PERSONS},
        "preventable": _graded(Prevention, lambda c: c.preventions),
        "adversary": _graded(Conduct, lambda c: c.conducts),
        "usual (percentile, median)": lambda c: _unit(c.usual_percent, "%") + _not_known(c.usual_unknown),
        "collision types": lambda c: _counted(c.collision_types),
        "impact": lambda c: _unit(c.impact_m_s, "m/s"),
        **({_DEADLY: lambda c: _unit(c.death_risk_percent, "%")} if _hits_persons(columns) else {}),
        "at fault": lambda c: ", ".join(f"{who} {n}" for who, n in sorted(c.at_fault.items())) or "-",
        "deviation": lambda c: _unit(c.deviation_m, "m"),
        "distance to traffic": lambda c: ", ".join(f"{q} {d:g}" for q, d in c.realism_distance.items()) or "-",
        "in SUMO the same": lambda c: f"{c.verified_in_sumo}",
        "windows without a telling crash": _reasons,
        "protocol": lambda c: c.protocol,
        "roll-outs of a window, mean (at most)": lambda c: f"{_unit(c.mean_rollouts, '')}".strip() + f" ({c.rollouts})",
        "time": lambda c: f"{c.seconds:.0f} s",
    }
    return [[name, *(show(column) for column in columns)] for name, show in rows.items()]


_DEADLY = "deadly for pedestrians hit by the front (mean)"


def _hits_persons(columns: Sequence[MethodScores]) -> bool:
    return any(column.death_risk_percent is not None for column in columns)


def _comparisons(table: Table1, planner: str) -> list[Section]:
    pairs = [one for one in table.comparisons if one.planner == planner]
    why = _APART if any(one.p is None for one in pairs) else ""
    title = f"Windows in which just one of two methods succeeds, and McNemar's p{why}:"
    return [Section(title, ("", *COUNTS), _compared(pairs))] if pairs else []


_APART = " (-: the two searched by different protocols, so that a p-value would not compare the methods)"


def _compared(pairs: Sequence[MethodComparison]) -> list[list[str]]:
    found: dict[str, dict[str, str]] = {}
    for pair in pairs:
        cell = "-" if pair.p is None else f"{pair.only_first} : {pair.only_second}, p = {pair.p:.2g}"
        found.setdefault(f"{pair.first} : {pair.second}", {})[pair.count] = cell
    return [[name, *(cells[count] for count in COUNTS)] for name, cells in found.items()]


def _grouped(
    groups: Sequence[MethodScores], methods: Sequence[str], show: Callable[[MethodScores], str]
) -> list[list[str]]:
    rows = []
    for name in dict.fromkeys(one.source for one in groups):
        cells = {one.method: one for one in groups if one.source == name}
        rows.append([name, str(max(one.n for one in cells.values())), *(show(cells[method]) for method in methods)])
    return rows


def _counts(c: MethodScores) -> str:
    counts = c.telling, c.flawless, c.successes, c.clean
    return " / ".join(map(str, counts)) + _not_known(c.telling_unknown)


def _telling(c: MethodScores) -> str:
    return _share(c.telling, c.n, c.telling_percent, c.telling_interval) + _not_known(c.telling_unknown)


def _offences(columns: Sequence[MethodScores]) -> list[list[str]]:
    """A row for each offence of an adversary, gross ones first; then those of the ego."""
    order = sorted(get_args(OffenceName), key=lambda name: name not in GROSS_OFFENCES)
    rows = [["crashes", *(str(c.crashes) for c in columns)]]
    for name in order:
        if name in OFFENCES_ON_FOOT and not any(c.offences_told.get(name) for c in columns):
            continue
        words = name.replace("_", " ") + ("" if name in GROSS_OFFENCES else " (a mistake)")
        rows.append([words, *(_told(c.offences, name, c) for c in columns)])
    done = [name for name in order if any(c.ego_offences.get(name) for c in columns)]
    return rows + [
        [f"the ego: {name.replace('_', ' ')}", *(_told(c.ego_offences, name, c) for c in columns)] for name in done
    ]


_BY_USUAL = "Windows with a telling crash / a flawless one by an adversary at least so usual (percentile):"
_SHOWN_USUAL = (0, 5, 10, 25, 50, 75)  # of `scores.USUAL`; the JSON and the picture have all


def _by_usual(columns: Sequence[MethodScores]) -> list[list[str]]:
    def shares(c: MethodScores, least: str) -> str:
        return f"{c.telling_by_usual[least]} / {c.flawless_by_usual[least]} %"

    return [[f"{least} %", *(shares(c, str(least)) for c in columns)] for least in _SHOWN_USUAL]


def _told(offences: dict[str, int], name: str, c: MethodScores) -> str:
    """The share of the crashes in which an offence can be told; of the others how many there are."""
    told = c.offences_told.get(name, 0)
    return (_part(offences.get(name, 0), told) if told else "-") + _not_known(c.crashes - told)


def _graded(grade: type[StrEnum], counts: Callable[[MethodScores], Mapping[str, int]]) -> Callable[[MethodScores], str]:
    """The number of crashes of each grade, in the order of the grades."""

    def words(column: MethodScores) -> str:
        found = counts(column)
        return ", ".join(f"{found[one]} {one.replace('_', ' ')}" for one in grade if found.get(one)) or "-"

    return words


def _red_lights(c: MethodScores) -> str:
    known = f"{c.red_lights} in {c.red_light_windows} of {c.lights_known} windows" if c.lights_known else "-"
    return known + _not_known(c.windows - c.lights_known)


def _flawed(flaw: Flaw) -> Callable[[MethodScores], str]:
    return lambda column: _part(column.flaws.get(flaw, 0), column.crashes)


def _reasons(found: MethodScores) -> str:
    def words(reason: str, n: int) -> str:
        offences = ", ".join(f"{m} {name.replace('_', ' ')}" for name, m in found.failing_offences.items())
        how = f" ({offences})" if reason == "gross_offence_only" and offences else ""
        return f"{n} {reason.replace('_', ' ')}{how}"

    return ", ".join(words(reason, n) for reason, n in found.failures.items() if n) or "-"


def _part(some: int, n: int) -> str:
    return f"{percent(some, n)} %"


def _not_known(n: int) -> str:
    return f"; not known {n}" if n else ""


def _share(part: int, n: int, percent: float, bounds: tuple[float, float]) -> str:
    return f"{part} of {n}: {percent:.0f} % ({bounds[0]:.0f} to {bounds[1]:.0f})"


def _unit(value: float | None, unit: str) -> str:
    return "-" if value is None else f"{value} {unit}"


def _counted(types: Mapping[str, int]) -> str:
    return ", ".join(f"{n} {name.replace('_', ' ')}" for name, n in sorted(types.items())) or "-"
