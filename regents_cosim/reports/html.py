"""The report: cases, scores and a player in one HTML file that needs nothing else."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import msgspec
from markupsafe import Markup

from regents_cosim.reports.packing import packed
from regents_cosim.reports.page_case import PageCase
from regents_cosim.reports.page_colours import DARK, LIGHT
from regents_cosim.reports.page_map import page_maps

SCHEMA = 1
_PAGE = Path(__file__).parent / "page"
_SCRIPTS = ("unpack", "colours", "camera", "ground", "vehicles", "plots", "player", "sheets", "table", "app")


@dataclass(frozen=True)
class Score:
    """One number of one driver, with its 95 % interval."""

    label: str
    driver: str
    value: str
    detail: str = ""
    share: float | None = None  # of the scale, 0 to 1
    interval: tuple[float, float] | None = None  # likewise


@dataclass(frozen=True, eq=False)
class Report:
    """All that a report says."""

    title: str
    subtitle: str
    drivers: tuple[str, ...]  # who drove the egos, in the order of the runs of each case
    driven: bool  # anew, for this report
    scores: tuple[Score, ...]
    cases: tuple[PageCase, ...]
    command: str = ""
    folder: Path | None = None  # of the suite

    @property
    def worst_first(self) -> list[PageCase]:
        """The cases in the order of the page."""
        return sorted(self.cases, key=lambda case: (case.badness, case.scenario.id))


def html_page(report: Report) -> str:
    """The page as one file. Ids, names and messages may hold any character."""
    cases = report.worst_first
    maps = page_maps([case.scenario for case in cases])
    home = {id(scenario): index for index, one in enumerate(maps) for scenario in one.cases}
    places = [home[id(case.scenario)] for case in cases]
    rows = [case.row(place) for case, place in zip(cases, places, strict=True)]
    changes = [row["change"] for row in rows]
    return _template().render(
        report=report,
        scores=_by_label(report.scores),
        changes={name: changes.count(name) for name in ("broken", "fixed", "unchanged")},
        kinds=_counts(hit["kind"] for row in rows for hit in row["endings"] if hit),
        light=LIGHT,
        dark=DARK,
        style=_inlined("style.css"),
        script=Markup("\n").join(_inlined(f"{name}.js") for name in _SCRIPTS),
        page=_script_data({"drivers": report.drivers, "driven": report.driven, "rows": rows}),
        maps=[packed(one.content()) for one in maps],
        payloads=(
            packed(case.content(maps[place], report.folder, report.driven))
            for case, place in zip(cases, places, strict=True)
        ),
    )


def json_twin(report: Report) -> bytes:
    """The scores and the table for machines."""
    rows = [
        {k: v for k, v in case.row(0).items() if k not in ("map", "otherwise")}
        | {"outcome": case.scenario.attack.outcome if case.scenario.attack else None}
        for case in report.worst_first
    ]
    content = {
        "schema": SCHEMA,
        "title": report.title,
        "command": report.command,
        "drivers": report.drivers,
        "scores": report.scores,
        "cases": rows,
    }
    return msgspec.json.format(msgspec.json.encode(content), indent=1)


def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string((_PAGE / "page.html").read_text("utf-8"))


def _inlined(name: str) -> Markup:
    """A file of our own, as it is."""
    return Markup((_PAGE / name).read_text("utf-8"))


def _script_data(content: object) -> Markup:
    """JSON in which nothing can end a <script> element or begin a comment."""
    text = msgspec.json.encode(content).decode()
    for letter in "<>&\u2028\u2029":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return Markup(text)


def _by_label(scores: Sequence[Score]) -> dict[str, list[Score]]:
    found: dict[str, list[Score]] = {}
    for score in scores:
        found.setdefault(score.label, []).append(score)
    return found


def _counts(words: Any) -> list[tuple[str, int]]:
    """The most frequent first."""
    found: dict[str, int] = {}
    for word in words:
        found[word] = found.get(word, 0) + 1
    return sorted(found.items(), key=lambda item: (-item[1], item[0]))
