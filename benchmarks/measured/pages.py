"""The tables of README, results and performance, made from `docs/measured.json` and put between their marks."""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.measured.bars import PercentWithInterval, draw_bars
from regents_cosim.norms.grades import Conduct, Prevention

ROOT = Path(__file__).resolve().parents[2]
MEASURED = ROOT / "docs/measured.json"
PAGES = ("README.md", "docs/results.md", "docs/performance.md")
PICTURE = ROOT / "docs/results.png"
_MARKED = re.compile(r"(<!-- measured: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
_NAMES = {"focused": "`focused`", "regents": "ReGentS", "king": "KING"}
_METHODS = tuple(_NAMES)
_SIGNIFICANT = 0.05


def write_pages() -> None:
    """Put the tables of today's numbers into the pages, and draw the figure of the results."""
    measured = json.loads(MEASURED.read_text())
    for name in PAGES:
        page = ROOT / name
        page.write_text(filled(page.read_text(), measured))
    groups = {
        row.in_figure: [PercentWithInterval(one["telling_percent"], *one["telling_interval"]) for one in scores]
        for row, scores in _headline(measured)
        if row.in_figure
    }
    draw_bars("Windows with a telling crash of idm", [_NAMES[one].strip("`") for one in _METHODS], groups, PICTURE)


def filled(page: str, measured: dict[str, Any]) -> str:
    """A page with the measured tables between its marks."""
    return _MARKED.sub(lambda found: f"{found[1]}{_part(found[2], measured)}\n{found[3]}", page)


def _part(name: str, measured: dict[str, Any]) -> str:
    try:
        return _PARTS[name](measured).strip()
    except KeyError:
        return "Not measured yet at this commit: `make results`."


def _grid(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    first, *others = (f"| {' | '.join(line)} |" for line in (head, *rows))
    return "\n".join([first, "|---" * len(head) + "|", *others])


_GRADES = ("windows with a telling crash", "with a flawless one")


def _share(row: dict[str, Any], what: str) -> str:
    low, high = row[f"{what}_interval"]
    return f"{row[what]}/{row['n']}: {row[f'{what}_percent']:.0f} % ({low:.0f}-{high:.0f})"


def _shares(row: dict[str, Any]) -> list[str]:
    return [_share(row, what) for what in ("telling", "flawless")]


def _both(row: dict[str, Any]) -> str:
    parts = ((row[what], row[f"{what}_interval"]) for what in ("telling", "flawless"))
    return "; ".join(f"{count}/{row['n']} ({low:.0f}-{high:.0f})" for count, (low, high) in parts)


def _counts(row: dict[str, Any]) -> str:
    return f"{row['telling']}/{row['flawless']}/{row['n']}"


def _rows(part: Sequence[dict[str, Any]], planner: str, source: str) -> list[dict[str, Any]]:
    """The rows of the methods, in the order of the columns."""
    found = {row["method"]: row for row in part if (row["planner"], row["source"]) == (planner, source)}
    return [found[method] for method in _METHODS if method in found]


class _Headline(NamedTuple):
    step: str
    planner: str
    name: str
    in_figure: str
    in_readme: bool


# The rows of the first table: the step and planner, the row's names on the page and in the figure (none: not there),
# and whether the README has it.
_HEADLINE = (
    _Headline("made", "idm", "made places, with a conflict", "held out", True),
    _Headline("made_by_chance", "idm", "made places, by chance", "held out, by chance", True),
    _Headline("made_long", "idm", "made places, by chance, 16 s", "held out, 16 s", False),
    _Headline("careful", "careful", "made places, with a conflict, planner `careful`", "", False),
    _Headline("shipped", "idm", "shipped networks (*tuned on*), with a conflict", "tuned on", True),
    _Headline("shipped_by_chance", "idm", "shipped networks (*tuned on*), by chance", "tuned on, by chance", True),
    _Headline("shipped_long", "idm", "shipped networks (*tuned on*), by chance, 16 s", "tuned on, 16 s", False),
)


def _headline(measured: dict[str, Any]) -> list[tuple[_Headline, list[dict[str, Any]]]]:
    """The rows of the first table that were measured, each with the scores of its methods."""
    found = measured["results"]
    return [(row, _rows(found[row.step]["scores"], row.planner, "all")) for row in _HEADLINE if row.step in found]


def _telling(measured: dict[str, Any]) -> str:
    rows = [[row.name, *map(_both, scores), *_not_run(scores)] for row, scores in _headline(measured)]
    return _grid(["", *_NAMES.values()], rows)


def _not_run(found: Sequence[dict[str, Any]]) -> list[str]:
    """The cells of the methods that were not run there."""
    return ["-"] * (len(_METHODS) - len(found))


def _readme(measured: dict[str, Any]) -> str:
    """The main rows in few words, with the number of windows at the head of a row."""
    rows = []
    for row, scores in _headline(measured):
        if row.in_readme:
            windows = sorted(one["n"] for one in scores)
            cells = [f"{one['telling_percent']:.0f}/{one['flawless_percent']:.0f} %" for one in scores]
            rows.append([f"{row.name} ({_range((windows[0], windows[-1]))} windows)", *cells])
    return _grid(["", *_NAMES.values()], rows)


def _range(ends: Sequence[float]) -> str:
    low, high = (f"{end:.0f}" for end in (ends[0], ends[-1]))
    return low if low == high else f"{low}-{high}"


def _about(measured: dict[str, Any]) -> str:
    versions = ", ".join(f"{name} {number}" for name, number in measured["versions"].items())
    seeds = ", ".join(map(str, measured["seeds"]))
    form = "the quick form (`make results QUICK=1`)" if measured["quick"] else "the full form (`make results`)"
    return (
        f"Commit `{measured['commit']}`, seeds {seeds}, {form}. {versions}. {measured['machine']}. "
        "The interval in brackets is the 95 % Wilson interval [percent]."
    )


def _figure(measured: dict[str, Any]) -> str:
    return f"![Share of windows with a telling crash, by place and method]({PICTURE.name})"


def _crashes(measured: dict[str, Any]) -> str:
    rows = []
    for planner, step in (("idm", "shipped"), ("careful", "careful")):
        for row in _rows(measured["results"].get(step, {}).get("scores", ()), planner, "all"):
            counts = (
                row["n"],
                row["crashes"],
                row["clean"],
                row["preventions"].get(Prevention.PREVENTABLE, 0),
                row["conducts"].get(Conduct.KEEPS_RULES, 0),
                row["conducts"].get(Conduct.MISTAKE, 0),
                row["telling"],
                row["flawless"],
                row["verified_in_sumo"],
            )
            rows.append([f"`{planner}`", _NAMES[row["method"]], *map(str, counts)])
    head = ["planner", "method", "windows", "crashes", "windows with a clean one", "crashes preventable by braking"]
    head += ["adversary keeps every rule", "makes a mistake", "windows with a telling one", "with a flawless one"]
    return _grid([*head, "crashes verified in SUMO"], rows)


def _by_place(measured: dict[str, Any]) -> str:
    results = measured["results"]
    rows = []
    for step in ("made", "shipped"):
        scores = results[step]["by_source"] if step in results else []
        for place in dict.fromkeys(row["source"] for row in scores):
            rows.append([place.removesuffix(".sumocfg"), *map(_counts, _rows(scores, "idm", place))])
    return _grid(["place", *_NAMES.values()], rows)


def _equal(measured: dict[str, Any]) -> str:
    rows = [
        [row["method"].partition(",")[0], *_shares(row), f"{row['mean_rollouts']:.0f}"]
        for row in measured["results"]["equal"]["scores"]
    ]
    return _grid(["search", *_GRADES, "roll-outs a window, mean"], rows)


def _persons(measured: dict[str, Any]) -> str:
    rows = [
        [row["source"].removesuffix(".sumocfg"), *_shares(row)] for row in measured["results"]["persons"]["by_source"]
    ]
    return _grid(["network", *_GRADES], rows)


def _fit(measured: dict[str, Any]) -> str:
    rows = [
        [row["network"], str(row["agents"]), f"{row['smooth_mean_cm']:.2f}", f"{row['smooth_p99_cm']:.2f}"]
        for row in measured["results"]["fit"]
    ]
    return _grid(["network", "vehicles", "mean error [cm]", "99th percentile [cm]"], rows)


def _transfer(measured: dict[str, Any]) -> str:
    rows = []
    for row in measured["results"]["transfer"]:
        low, high = row["interval_percent"]
        share = f"{row['same_crash_percent']:.0f} % ({low:.0f}-{high:.0f})"
        rows.append([row["place"], str(row["crashes"]), f"{row['same_crash']}: {share}", str(row["invented"])])
    return _grid(["replayed in", "crashes", "same crash, same step", "crashes that the case does not have"], rows)


def _planners(measured: dict[str, Any]) -> str:
    found = measured["results"]["planners"]
    counts = ("crashes", "telling_crashes", "flawless_crashes", "ego_at_fault", "other_at_fault")
    rows = [
        [f"`{row['planner']}`", *(str(row[one]) for one in counts), f"{row['ordinary_completion_percent']} %"]
        for row in found["rows"]
    ]
    apart = [f"`{row['planner']}`" for row in found["rows"] if (row["p_value"] or 1.0) < _SIGNIFICANT]
    said = f"{', '.join(apart) or 'No planner'} differs significantly from the one above it (McNemar)."
    if found["commit"] != measured["commit"]:
        said += f" Commit `{found['commit']}`."
    head = ["planner", "crashes", "telling", "flawless", "ego at fault", "other at fault", "route completion"]
    return f"{_grid(head, rows)}\n\n{said}"


def _performance(measured: dict[str, Any]) -> str:
    found = measured["results"]["performance"]
    head = [
        "what",
        "for one",
        "CPU s, first run",
        "first / second",
        "CPU s, second run",
        "yardsticks",
        "s, second run",
        "MiB",
    ]
    return f"{_grid(head, found['rows'])}\n\n{found['note']}"


_PARTS = {
    "telling": _telling,
    "readme": _readme,
    "about": _about,
    "figure": _figure,
    "crashes": _crashes,
    "places": _by_place,
    "equal": _equal,
    "persons": _persons,
    "fit": _fit,
    "transfer": _transfer,
    "planners": _planners,
    "performance": _performance,
}
