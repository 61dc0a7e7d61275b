"""The texts around a picture: its title, its story, the time and the speeds."""

import re
import unicodedata

from regents_cosim.reports.crash_moments import braking_line
from regents_cosim.reports.drawing.canvas import Canvas, Px, shorten, text_width
from regents_cosim.reports.drawing.palette import ADVERSARY, FAINT_INK, HAIRLINE, INK, PANEL, Colour, shade
from regents_cosim.reports.drawing.pictured_case import PicturedCase
from regents_cosim.scenario.attack_record import Collision, CollisionType, Outcome
from regents_cosim.verdicts.behaviour import death_risk_of
from regents_cosim.verdicts.words import adversary_words, braking_words, crash_words, kmh, verdict_words

HEADER_PX = 66  # with one line of text
STRIP_PX = 30  # title of one of two pictures

EDGE_PX = 16
_WORDS_PX, _LINE_PX = 13, 17
STORY_PX, STORY_LINE_PX = 15, 20
_UNITS = re.compile(r"(?<=\d) (?=(s|m|km/h|m/s2|%)\b)")
_WIDER = 1.02  # letters that are drawn larger and reduced, compared with `text_width`
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


def header_height(scene: PicturedCase, width: int) -> int:
    """The height of a picture's header [px], given its width [px]: it has as many lines as its text needs."""
    return HEADER_PX + _LINE_PX * (len(caption_lines(scene, width)) - 1)


def draw_header(scene: PicturedCase, step: int, width: int, zoom: int) -> Canvas:
    """Draw case, planner, method and collision on the left; time and speeds on the right; the time as a line below.

    On that line a thin tick is where the adversary enters the ego's path, a thick one the collision.
    """
    lines = caption_lines(scene, width)
    height = header_height(scene, width)
    canvas = Canvas.blank((width, height), zoom, PANEL)
    scenario = scene.scenario
    hit = scene.collision is not None and step >= scene.collision.step
    canvas.text((width - EDGE_PX, 33), f"{step * scenario.dt:.1f} s", 24, ADVERSARY if hit else INK, "rs", bold=True)
    _draw_speeds(canvas, scene, step, width - EDGE_PX)
    room, name = _room(width), plain(scenario.id)
    size = next((size for size in range(18, 12, -1) if text_width(name, size) <= room), 12)
    canvas.text((EDGE_PX, 30), shorten(name, size, room), size, INK, bold=True)
    for number, line in enumerate(lines):
        canvas.text((EDGE_PX, 52 + number * _LINE_PX), line, _WORDS_PX, FAINT_INK)
    _draw_timeline(canvas, scene, step, width, height)
    return canvas


def _draw_speeds(canvas: Canvas, scene: PicturedCase, step: int, right: Px) -> None:
    tracks = scene.scenario.tracks
    for index, colour in scene.main.items():
        if tracks.valid[index, step]:
            words = f"{called(index)} {kmh(tracks.speed[index, step])}"
            canvas.text((right, 52), words, 12, shade(colour), "rs")
            right -= text_width(words, 12) + 14


def called(index: int | bool) -> str:
    """One of the main road users, in a picture."""
    return "adversary" if index else "ego"


def _room(width: int) -> int:
    """The width [px] for text beside the time."""
    return width - 2 * EDGE_PX - 230


def caption_lines(scene: PicturedCase, width: int) -> list[str]:
    """The description of a case in as many lines as it needs; a name longer than a line is cut."""
    return _lines(describe(scene), _WORDS_PX, _room(width))


def story_lines(scene: PicturedCase, width: int) -> list[str]:
    """The story of a case in as many lines as it needs, and how both drivers brake in lines of their own."""
    brakes = braking_line(scene.scenario, scene.scenario.tracks, scene.collision)
    return [line for words in (story(scene), brakes) for line in _lines(words, STORY_PX, width - 2 * EDGE_PX)]


def _lines(words: str, size: int, room: int) -> list[str]:
    lines = [""]
    for word in map(plain, _UNITS.sub("\N{NO-BREAK SPACE}", words).split(" ")):
        longer = f"{lines[-1]} {word}".strip()
        if _WIDER * text_width(longer, size) <= room:
            lines[-1] = longer
        else:
            lines.append(shorten(word, size, room))
    return [line for line in lines if line]


def draw_strip(words: str, colour: Colour, width: int, zoom: int) -> Canvas:
    """Draw the title of one of two pictures."""
    canvas = Canvas.blank((width, STRIP_PX), zoom, PANEL)
    canvas.text((EDGE_PX, 20), shorten(plain(words), 14, width - 2 * EDGE_PX), 14, colour, bold=True)
    return canvas


def describe(scene: PicturedCase) -> str:
    """Planner, method and outcome in one line."""
    attack = scene.scenario.attack
    if attack is None:
        source = scene.scenario.provenance
        return f"recorded traffic, before any attack · {source.source} {source.file} at {source.begin_s:g} s"
    words = [f"planner {attack.planner}", f"attack {attack.method}"]
    hit = attack.collision
    if hit is None and scene.careful is not None:
        return " · ".join([*words, "a careful driver evades"])
    return " · ".join([*words, *ending(attack.outcome, hit)])


def story(scene: PicturedCase) -> str:
    """What happens, who breaks which rule, and what prevents it, in sentences; empty where nothing does."""
    scenario, hit, judged = scene.scenario, scene.collision, scene.scenario.judgement
    if hit is None:
        drive = scene.careful
        if scenario.attack is None or drive is None or drive.acts_s is None:
            return ""
        return f"A careful driver {braking_words(drive.shift_m)} from {drive.acts_s:.1f} s and avoids the collision."
    said = [crash_words(scenario.agents, scenario.tracks, hit)]
    if judged is not None:
        said.append(verdict_words(judged, adversary_words(scenario.agents, scenario.attack)))
    return " ".join(said)


def ending(outcome: Outcome, hit: Collision | None) -> list[str]:
    """How an attack ended, as parts of one line."""
    words = [] if outcome == "collision" and hit else [OUTCOMES[outcome]]
    if hit is not None:
        speed = f"impact {kmh(hit.relative_speed)}"
        words += [f"{COLLISION_TYPES[hit.collision_type]} at {hit.time_s:.1f} s", speed]
        if (risk := death_risk_of(hit)) is not None:
            words.append(deadly_words(risk))
    return words


def deadly_words(risk: float) -> str:
    """How deadly an impact is, in words."""
    return f"deadly for {100.0 * risk:.0f} % of pedestrians"


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
    for moment, half_px in ((scene.enters_lane, 1), (scene.collision and scene.collision.step, 2)):
        if moment is not None:
            at = width * moment / last
            canvas.box(at - half_px, bottom - 6, min(at + half_px, width), bottom, ADVERSARY)
