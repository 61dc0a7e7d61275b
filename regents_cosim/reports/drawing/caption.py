"""The text and scales around a picture: title, time, legend, scale bar."""

import unicodedata

import numpy as np

from regents_cosim.attack_record import Collision, CollisionType, Outcome
from regents_cosim.judgement import Judgement, Manoeuvre
from regents_cosim.reports.drawing.camera import View
from regents_cosim.reports.drawing.canvas import Canvas, shorten, text_width
from regents_cosim.reports.drawing.palette import (
    ADVERSARY,
    EGO,
    EVASION,
    FAINT_INK,
    HAIRLINE,
    INK,
    OTHER,
    PANEL,
    Colour,
    mix,
    shade,
)
from regents_cosim.reports.drawing.pictured_case import PicturedCase, draw_burst
from regents_cosim.verdicts.injury import death_risk_of
from regents_cosim.verdicts.words import DRIVERS, braking_words

HEADER_PX = 66  # with one line of text
FOOTER_PX = 38
STRIP_PX = 30  # title of one of two pictures

_EDGE_PX = 16
_WORDS_PX, _LINE_PX = 13, 17
COLLISION_TYPES: dict[CollisionType, str] = {
    "rear_end_by_ego": "rear-end by the ego",
    "rear_end_by_adversary": "rear-end into the ego",
    "side_swipe": "side-swipe",
    "t_bone": "T-bone",
    "head_on": "head-on",
    "person_by_front": "person hit by the front",
    "person_by_side": "person at the side",
}
OUTCOMES: dict[Outcome, str] = {
    "collision": "collision",
    "no_collision": "no collision found",
    "no_candidate": "no road user may attack",
    "already_colliding": "collides without an attack",
    "diverged": "attack diverged",
    "planner_error": "planner failed",
}
_SCALES_M = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)


def header_height(scene: PicturedCase, width: int) -> int:
    """The height of a picture's header [px], given its width [px]: it has as many lines as its text needs."""
    return HEADER_PX + _LINE_PX * (len(caption_lines(scene, width)) - 1)


def draw_header(scene: PicturedCase, step: int, width: int, zoom: int) -> Canvas:
    """Draw case, planner, method and collision on the left, and the time on the right and as a line below."""
    lines = caption_lines(scene, width)
    height = header_height(scene, width)
    canvas = Canvas.blank((width, height), zoom, PANEL)
    scenario = scene.scenario
    hit = scene.collision is not None and step >= scene.collision.step
    canvas.text((width - _EDGE_PX, 33), f"{step * scenario.dt:.1f} s", 24, ADVERSARY if hit else INK, "rs", bold=True)
    canvas.text((width - _EDGE_PX, 52), f"step {step} of {scenario.tracks.steps - 1}", 12, FAINT_INK, "rs")
    room, name = _room(width), plain(scenario.id)
    size = next((size for size in range(18, 12, -1) if text_width(name, size) <= room), 12)
    canvas.text((_EDGE_PX, 30), shorten(name, size, room), size, INK, bold=True)
    for number, line in enumerate(lines):
        canvas.text((_EDGE_PX, 52 + number * _LINE_PX), line, _WORDS_PX, FAINT_INK)
    _draw_timeline(canvas, scene, step, width, height)
    return canvas


def _room(width: int) -> int:
    """The width [px] for text beside the time."""
    return width - 2 * _EDGE_PX - 120


def caption_lines(scene: PicturedCase, width: int) -> list[str]:
    """The description of a case in as many lines as it needs; a name longer than a line is cut."""
    lines = [""]
    for word in plain(describe(scene)).split(" "):
        longer = f"{lines[-1]} {word}".strip()
        if text_width(longer, _WORDS_PX) <= _room(width):
            lines[-1] = longer
        else:
            lines.append(shorten(word, _WORDS_PX, _room(width)))
    return [line for line in lines if line]


def draw_footer(scene: PicturedCase, view: View, width: int, zoom: int) -> Canvas:
    """Draw the legend of colours, and a scale of about ten metres."""
    canvas = Canvas.blank((width, FOOTER_PX), zoom, PANEL)
    canvas.box(0, 0, width, 1, HAIRLINE)
    _draw_legend(canvas, scene)
    _draw_scale(canvas, view, width)
    return canvas


def draw_strip(words: str, colour: Colour, width: int, zoom: int) -> Canvas:
    """Draw the title of one of two pictures."""
    canvas = Canvas.blank((width, STRIP_PX), zoom, PANEL)
    canvas.text((_EDGE_PX, 20), shorten(plain(words), 14, width - 2 * _EDGE_PX), 14, colour, bold=True)
    return canvas


def describe(scene: PicturedCase) -> str:
    """Planner, method and outcome in one line."""
    attack = scene.scenario.attack
    if attack is None:
        source = scene.scenario.provenance
        return f"recorded traffic, before any attack · {source.source} {source.file} at {source.begin_s:g} s"
    how = " as published" if attack.settings.get("as_published") else ""
    words = [f"planner {attack.planner}", f"attack {attack.method}{how}"]
    hit, dt = attack.collision, scene.scenario.dt
    judged = scene.scenario.judgement
    if hit is None and scene.gentlest is not None:
        return " · ".join([*words, f"the ego evades: {manoeuvre_words(scene.gentlest, dt)}"])
    verdict = [way_out(judged, dt)] if judged and judged.avoidability else []
    return " · ".join([*words, *ending(attack.outcome, hit), *verdict])


def ending(outcome: Outcome, hit: Collision | None) -> list[str]:
    """How an attack ended, as parts of one line."""
    words = [] if outcome == "collision" and hit else [OUTCOMES[outcome]]
    if hit is not None:
        speed = f"impact {hit.relative_speed:.1f} m/s ({3.6 * hit.relative_speed:.0f} km/h)"
        words += [f"{COLLISION_TYPES[hit.collision_type]} at {hit.time_s:.1f} s", speed]
        if (risk := death_risk_of(hit)) is not None:
            words.append(deadly_words(risk))
    return words


def deadly_words(risk: float) -> str:
    """How deadly an impact is, in words."""
    return f"deadly for {100.0 * risk:.0f} % of pedestrians"


def way_out(judgement: Judgement, dt: float) -> str:
    """Whether and until when the collision could have been avoided, and how a careful driver would do it."""
    found = judgement.avoidability
    if found is None or found.gentlest is None or found.last_onset_step is None:
        return "proven unavoidable" if judgement.unavoidable else "no way out known"
    how = manoeuvre_words(found.gentlest, dt) + _behind(len(judgement.into_evasion))
    if judgement.escape == "not in time":
        return f"avoidable only with knowledge of what comes: {how}"
    return f"avoidable until {found.last_onset_step * dt:.1f} s{_not_careful(judgement)}: {how}"


def _behind(followers: int) -> str:
    """A short form of the text of `drive_words`, since a picture has one line for all."""
    if not followers:
        return ""
    return f" ({'a replayed log hits' if followers == 1 else f'{followers} replayed logs hit'} its back)"


def _not_careful(judgement: Judgement) -> str:
    """A remark if the careful driver crashes too; empty where that was not checked."""
    crashes = any(drive.driver == "careful" and not drive.avoids for drive in judgement.drivers)
    return ", though not by a careful driver" if crashes else ""


def manoeuvre_words(manoeuvre: Manoeuvre, dt: float) -> str:
    """A manoeuvre in a few words."""
    words = []
    if manoeuvre.driver:
        words.append(f"{DRIVERS[manoeuvre.driver]} {braking_words(manoeuvre.shift)}")
    elif manoeuvre.accel:
        verb = "brake" if manoeuvre.accel < 0 else "speed up"
        lasting = "" if manoeuvre.lasting_s is None else f" for {manoeuvre.lasting_s:g} s"
        words.append(f"{verb} {abs(manoeuvre.accel):.1f} m/s2{lasting}")
    if manoeuvre.shift and not manoeuvre.driver:
        side = "left" if manoeuvre.shift > 0 else "right"
        words.append(f"steer {abs(manoeuvre.shift):.1f} m to the {side}")
    where = {"shoulder": " onto the shoulder", "oncoming": " into lanes of others"}.get(manoeuvre.side or "", "")
    where += " past a red light" if manoeuvre.runs_red else ""
    return f"{' and '.join(words) or 'hold the speed'}{where} from {manoeuvre.onset_step * dt:.1f} s"


def plain(words: str) -> str:
    """The `words`, restricted to the letters in the pictures' font."""
    bare = unicodedata.normalize("NFKD", words.replace("ß", "ss"))
    letters = (letter for letter in bare if not unicodedata.combining(letter))
    return "".join(letter if letter.isascii() or letter == "·" else "?" for letter in letters)


# --- parts ------------------------------------------------------------------------------------


def _draw_timeline(canvas: Canvas, scene: PicturedCase, step: int, width: int, bottom: int) -> None:
    last = max(scene.scenario.tracks.steps - 1, 1)
    canvas.box(0, bottom - 3, width, bottom, HAIRLINE)
    canvas.box(0, bottom - 3, width * step / last, bottom, FAINT_INK)
    if scene.collision is not None:
        at = width * scene.collision.step / last
        canvas.box(at - 2, bottom - 6, min(at + 2, width), bottom, ADVERSARY)


def _draw_legend(canvas: Canvas, scene: PicturedCase) -> None:
    middle = FOOTER_PX / 2 + 0.5
    x = float(_EDGE_PX)
    entries: list[tuple[Colour, str]] = [(EGO, "ego"), (OTHER, "other traffic")]
    if len(scene.main) > 1:
        entries.insert(1, (ADVERSARY, "adversary"))
    for colour, words in entries:
        canvas.box(x, middle - 5, x + 20, middle + 5, shade(colour))
        canvas.box(x + 1, middle - 4, x + 19, middle + 4, colour)
        x += 26 + canvas.text((x + 26, middle + 4.5), words, 13, INK) + 20
    if scene.scenario.log is not None:
        tint = mix(PANEL, ADVERSARY if len(scene.main) > 1 else EGO, 0.8)
        canvas.dashed(np.array([[x, middle], [x + 26, middle]]), tint, 1.5, (6.0, 4.0))
        x += 32 + canvas.text((x + 32, middle + 4.5), "before the attack", 13, INK) + 20
    if scene.scenario.evasion is not None:
        canvas.dashed(np.array([[x, middle], [x + 26, middle]]), EVASION, 1.5, (6.0, 4.0))
        x += 32 + canvas.text((x + 32, middle + 4.5), "evasion", 13, INK) + 20
    if scene.collision is not None:
        draw_burst(canvas, np.array([x + 8, middle]), 7.0)
        canvas.text((x + 22, middle + 4.5), "collision", 13, INK)


def _draw_scale(canvas: Canvas, view: View, width: int) -> None:
    metres = max(m for m in _SCALES_M if m * view.px_per_m <= 130 or m == 1)
    length = metres * view.px_per_m
    right, y = width - _EDGE_PX, FOOTER_PX / 2 + 6.5
    for box in ((right - length, y - 1.5, right, y), (right - length, y - 6, right - length + 1.5, y)):
        canvas.box(*box, INK)
    canvas.box(right - 1.5, y - 6, right, y, INK)
    words = f"{metres} m"
    canvas.text((right - length / 2 - text_width(words, 12) / 2, y - 5), words, 12, INK)
