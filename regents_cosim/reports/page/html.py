"""Makes the report: cases, scores and a player in one self-contained HTML file."""

import base64
import hashlib
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import jinja2
import msgspec
from markupsafe import Markup, escape

from regents_cosim.evaluation.drives.crash_verdict import CrashCounts
from regents_cosim.reports.drawing.palette import (
    ADVERSARY,
    BURST,
    EGO,
    EVASION,
    FAINT_INK,
    HAIRLINE,
    INK,
    KERB,
    LAND,
    MARKING,
    OTHER,
    PANEL,
    PAVEMENT,
    ROAD,
    SECOND,
    SIGNAL_AMBER,
    SIGNAL_GREEN,
    SIGNAL_OFF,
    SIGNAL_RED,
    Colour,
    mix,
)
from regents_cosim.reports.page.case import PageEntry
from regents_cosim.reports.page.crash_groups import NeededWork, needed_work
from regents_cosim.reports.page.map import PageMap
from regents_cosim.reports.page.packing import packed, visible
from regents_cosim.system.files.output_files import MARK

# The terms of the page, each explained in a sentence; `docs/glossary.md` says more.
TERMS: dict[str, str] = {
    "telling": "Nothing spoils the crash as a test, a careful driver in the planner's place prevents it by braking, "
    "and the adversary makes no more than a mistake that people make: it tells something about the planner.",
    "flawless": "A telling crash whose adversary keeps every rule that can be told, and is not at fault.",
    "clean": "Nothing spoils the crash as a test: the adversary stays on the road, hits nobody else, does not come "
    "from behind, and stays within the grip of its tyres.",
    "preventable": "A careful driver in the planner's place avoids the crash by braking alone; by swerving: "
    "only with a swerve.",
    "at fault": "The one who broke a rule of the road and so caused the crash.",
    "careful driver": "The competent and careful human driver of UN Regulation 157: it reacts to what it can see, "
    "then brakes.",
    "adversary": "The road user that the attack steers so that a crash happens.",
    "attack": "The search for controls of other road users that make the ego crash.",
    "ego": "The vehicle that the planner under test drives.",
    "crashes without an attack": "The ego collides in recorded traffic, or in a harmless neighbour of a crash.",
    "impact": "The relative speed of the two when they first touch.",
    "least ttc": "The smallest time to collision in the drive: the time until the two touch if both continue as now.",
    "at": "When the ego is first touched.",
    "gap": "The distance between the outlines of ego and adversary.",
    "collision rate": "The share of the cases in which the ego collides, whoever is to blame.",
    "driving score": "Route completion, reduced by a factor for each infraction (CARLA leaderboard 1.0).",
    "route completion": "The share of the recorded path that the ego drives before it collides.",
    "decision time": "How long the planner took for a decision.",
    "broken": "The case crashes with the second planner and not with the first.",
    "worse": "The case crashes with both, and the crash says more against the second planner.",
    "better": "The case crashes with both, and the crash says less against the second planner: for example, it is not "
    "telling any more.",
    "fixed": "The case crashes with the first planner and not with the second.",
    "unchanged": "The case ends in the same way with both.",
}
_SAME = {
    "telling crashes": "telling",
    "flawless crashes": "flawless",
    "clean crashes": "clean",
    "impact speed": "impact",
    "gap to the adversary": "gap",
}


def term(words: str) -> str | None:
    """The explanation of a term of the page; None for ordinary words."""
    key = words.lower()
    return TERMS.get(_SAME.get(key, key))


SCHEMA = 3
_MOST_GROUPS = 3  # most groups of similar crashes per need in the summary
_BREAKS = re.compile(r"(?<=[:._/-])|(?<=[^\s:._/-]{24})")
_PAGE = Path(__file__).parent
_SCRIPTS = ("unpack", "colours", "camera", "ground", "vehicles", "plots", "player", "sheets", "table", "tips", "app")


@dataclass(frozen=True)
class Score:
    """One number of one driver, with its 95 % interval."""

    label: str
    driver: str
    value: str
    detail: str = ""
    share: float | None = None  # of the scale, 0 to 1, for the bar
    interval: tuple[float, float] | None = None  # ends of the interval, likewise


@dataclass(frozen=True, eq=False)
class Report:
    """The content of a report."""

    title: str
    subtitle: str
    drivers: tuple[str, ...]  # drivers of the egos, in the order of each case's runs
    driven: bool  # whether they drove for this report
    counts: dict[str, CrashCounts]  # by driver
    scores: tuple[Score, ...]
    cases: tuple[PageEntry, ...]
    maps: tuple[PageMap, ...]
    command: str = ""

    @property
    def fix_first(self) -> list[NeededWork]:
        """The groups of crashes of the last driver, the most urgent first."""
        return needed_work([case.crash for case in self.worst_first if case.crash])

    @property
    def crash_lines(self) -> list[str]:
        """A sentence on the crashes of each driver, as `regents attack` and `evaluate` print it."""
        several = len(self.drivers) > 1
        return [f"{name}: {found}" if several else str(found) for name, found in self.counts.items()]

    @property
    def worst_first(self) -> list[PageEntry]:
        """The cases in the order of the page."""
        return sorted(self.cases, key=lambda case: (case.badness, case.id))


def html_page(report: Report) -> str:
    """The page as one file. Ids, names and messages may contain any character."""
    cases = report.worst_first
    rows = [case.row for case in cases]
    changes = Counter(row["change"] for row in rows)
    style, script = _style(), _script()
    todo = report.fix_first
    groups = [group for work in todo for group in work.groups]
    member = {name: number for number, group in enumerate(groups) for name in group.cases}
    return _template().render(
        report=report,
        mark=MARK,
        scores=_by_label(report.scores),
        changes=changes,
        collision_types=_counts(hit["collision_type"] for row in rows for hit in row["endings"] if hit),
        todo=todo,
        number={group.first: member[group.first] for group in groups},
        shown=_MOST_GROUPS,
        style=style,
        script=script,
        policy=_policy(style, script),
        page=_script_data(
            visible(
                {
                    "drivers": report.drivers,
                    "driven": report.driven,
                    "terms": TERMS | {name: TERMS[of] for name, of in _SAME.items()},
                    "rows": [row | {"group": member.get(row["id"])} for row in rows],
                }
            )
        ),
        maps=[packed(visible(one.content())) for one in report.maps],
        payloads=(case.content for case in cases),
    )


def json_twin(report: Report) -> bytes:
    """The scores and the table as JSON."""
    rows = [
        {k: v for k, v in case.row.items() if k not in ("map", "otherwise")}
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
        "crashes": report.counts,
        "fix_first": report.fix_first,
        "cases": rows,
    }
    return msgspec.json.format(msgspec.json.encode(content), indent=1)


def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True, finalize=visible
    )
    environment.filters["breakable"] = _breakable
    environment.filters["termed"] = _termed
    return environment.from_string((_PAGE / "page.html").read_text("utf-8"))


def _breakable(name: str) -> Markup:
    """A name that may be broken after its punctuation, or within long parts without any."""
    return Markup("<wbr>").join(_BREAKS.split(visible(name)))


def _termed(words: str) -> Markup:
    meaning = term(words)
    return (
        Markup('<span class="term" tabindex="0" data-tip="{}">{}</span>').format(meaning, words)
        if meaning
        else escape(words)
    )


def _style() -> Markup:
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
    """The content security policy: only this script and this style; nothing is loaded, nothing is sent."""
    style_hash, script_hash = (
        base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in (style, script)
    )
    return (
        f"default-src 'none'; script-src 'sha256-{script_hash}'; style-src 'sha256-{style_hash}'; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )


def _script_data(content: object) -> Markup:
    """JSON that cannot end a <script> element or begin a comment."""
    text = msgspec.json.encode(content).decode()
    for letter in "<>&\u2028\u2029":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return Markup(text)


def _by_label(scores: Sequence[Score]) -> dict[str, list[Score]]:
    found: dict[str, list[Score]] = {}
    for score in scores:
        found.setdefault(score.label, []).append(score)
    return found


def _counts(words: Iterable[str]) -> list[tuple[str, int]]:
    """Words with their counts, the most frequent first."""
    return sorted(Counter(words).items(), key=lambda item: (-item[1], item[0]))


_NIGHT: Colour = (17, 20, 25)
_WHITE: Colour = (255, 255, 255)
_LIGHTS = {"burst": BURST, "red": SIGNAL_RED, "amber": SIGNAL_AMBER, "green": SIGNAL_GREEN, "off": SIGNAL_OFF}


def _css(colours: dict[str, Colour]) -> dict[str, str]:
    return {name: "#{:02x}{:02x}{:02x}".format(*colour) for name, colour in colours.items()}


# Colours of the page in its light and dark mode, equal to those of the pictures where both have them. Text is darker
# than bodies of its colour in the light mode and brighter in the dark mode, so that it has the contrast of 4.5 that
# WCAG 2.1 (1.4.3) requires.
LIGHT = _css(
    {
        "page": (250, 250, 248), "panel": PANEL, "hairline": HAIRLINE, "ink": INK, "faint": FAINT_INK,
        "land": LAND, "road": ROAD, "kerb": KERB, "pavement": PAVEMENT, "marking": MARKING, "other": OTHER,
        "ego": EGO, "adversary": ADVERSARY, "second": SECOND, "evasion": EVASION,
        "ego-ink": mix(EGO, INK, 0.1), "adversary-ink": mix(ADVERSARY, INK, 0.35),
        "second-ink": mix(SECOND, INK, 0.25), "evasion-ink": mix(EVASION, INK, 0.2),
        **_LIGHTS,
    }
)  # fmt: skip
DARK = _css(
    {
        "page": _NIGHT, "panel": (25, 29, 36), "hairline": (48, 54, 64), "ink": (232, 235, 240),
        "faint": (160, 169, 181), "land": (22, 26, 31), "road": (50, 56, 66), "kerb": (78, 86, 98),
        "pavement": (38, 43, 50),
        "marking": (120, 128, 140), "other": (128, 137, 150),
        "ego": mix(EGO, _WHITE, 0.3), "adversary": mix(ADVERSARY, _WHITE, 0.15),
        "second": mix(SECOND, _WHITE, 0.25), "evasion": mix(EVASION, _WHITE, 0.3),
        "ego-ink": mix(EGO, _WHITE, 0.5), "adversary-ink": mix(ADVERSARY, _WHITE, 0.35),
        "second-ink": mix(SECOND, _WHITE, 0.5), "evasion-ink": mix(EVASION, _WHITE, 0.5),
        **_LIGHTS,
    }
)  # fmt: skip
