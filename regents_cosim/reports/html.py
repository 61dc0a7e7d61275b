"""The report: cases, scores and a player in one HTML file that needs nothing else."""

import base64
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import msgspec
from markupsafe import Markup, escape

from regents_cosim.reports.crash_groups import groups
from regents_cosim.reports.packing import packed, visible
from regents_cosim.reports.page_case import PageEntry
from regents_cosim.reports.page_colours import DARK, LIGHT
from regents_cosim.reports.page_map import PageMap
from regents_cosim.system.products import MARK

SCHEMA = 1
_MOST_GROUPS = 6  # of crashes, in the summary
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
    driven: bool  # again, for this report
    scores: tuple[Score, ...]
    cases: tuple[PageEntry, ...]
    maps: tuple[PageMap, ...]
    command: str = ""

    @property
    def worst_first(self) -> list[PageEntry]:
        """The cases in the order of the page."""
        return sorted(self.cases, key=lambda case: (case.badness, case.id))


def html_page(report: Report) -> str:
    """The page as one file. Ids, names and messages may hold any character."""
    cases = report.worst_first
    rows = [case.row for case in cases]
    changes = [row["change"] for row in rows]
    style, script = _style(), _script()
    todo = groups([case.crash for case in cases if case.crash])
    member = {name: number for number, group in enumerate(todo) for name in group.cases}
    return _template().render(
        report=report,
        mark=MARK,
        scores=_by_label(report.scores),
        changes={name: changes.count(name) for name in ("broken", "fixed", "unchanged")},
        kinds=_counts(hit["kind"] for row in rows for hit in row["endings"] if hit),
        todo=[*enumerate(todo)][:_MOST_GROUPS],
        left_out=sum(group.crashes for group in todo[_MOST_GROUPS:]),
        style=style,
        script=script,
        policy=_policy(style, script),
        page=_script_data(
            visible(
                {
                    "drivers": report.drivers,
                    "driven": report.driven,
                    "rows": [row | {"group": member.get(row["id"])} for row in rows],
                }
            )
        ),
        maps=[packed(visible(one.content())) for one in report.maps],
        payloads=(case.content for case in cases),
    )


def json_twin(report: Report) -> bytes:
    """The scores and the table for machines."""
    rows = [
        {k: v for k, v in case.row.items() if k not in ("map", "otherwise", "evasion")}
        | {"outcome": case.attack.outcome if case.attack else None}
        for case in report.worst_first
    ]
    content = {
        "generator": MARK,
        "schema": SCHEMA,
        "title": report.title,
        "command": report.command,
        "drivers": report.drivers,
        "scores": report.scores,
        "fix_first": groups([case.crash for case in report.worst_first if case.crash]),
        "cases": rows,
    }
    return msgspec.json.format(msgspec.json.encode(content), indent=1)


def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True, finalize=visible
    )
    environment.filters["breakable"] = _breakable
    return environment.from_string((_PAGE / "page.html").read_text("utf-8"))


def _breakable(name: str) -> Markup:
    """A name that may be broken after its signs."""
    return Markup("").join(escape(letter) + (Markup("<wbr>") if letter in ":._/-" else "") for letter in visible(name))


def _style() -> Markup:
    """Colours by day and by night, then the style sheet."""
    light, dark = ("".join(f"--{name}: {value}; " for name, value in colours.items()) for colours in (LIGHT, DARK))
    return Markup(
        f"\n:root {{ color-scheme: light; {light}}}\n"
        f':root[data-theme="dark"] {{ color-scheme: dark; {dark}}}\n'
        f"@media (prefers-color-scheme: dark) {{ :root:not([data-theme]) {{ color-scheme: dark; {dark}}} }}\n"
        + (_PAGE / "style.css").read_text("utf-8")
    )


def _script() -> Markup:
    parts = "\n".join((_PAGE / f"{name}.js").read_text("utf-8") for name in _SCRIPTS)
    return Markup(f'\n"use strict";\n(() => {{\n{parts}\n}})();\n')


def _policy(style: str, script: str) -> str:
    """What the browser may run and apply: this very script and style; nothing is loaded, nothing is sent."""
    style_hash, script_hash = (
        base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in (style, script)
    )
    return (
        f"default-src 'none'; script-src 'sha256-{script_hash}'; style-src 'sha256-{style_hash}'; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )


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
