"""Draws the legend: every kind of mark in a picture, with its meaning."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np

from regents_cosim.reports.drawing.canvas import Canvas, Px, text_width
from regents_cosim.reports.drawing.marks import draw_burst, draw_rule_broken, draw_second, draw_seen, draw_tooth
from regents_cosim.reports.drawing.palette import (
    ADVERSARY,
    EGO,
    EVASION,
    FAINT_INK,
    INK,
    OTHER,
    PANEL,
    SECOND,
    SIGNAL_AMBER,
    SIGNAL_GREEN,
    SIGNAL_RED,
    Colour,
    mix,
    shade,
)
from regents_cosim.reports.drawing.pictured_case import PicturedCase

LINE_PX = 22
_WORDS_PX = 13
_ICON_PX, _GAP_PX = 28, 16  # room for an icon; between two entries

Icon = Callable[[Canvas, Px, Px], None]  # draws at left, middle [px]


class LegendEntry(NamedTuple):
    """A mark and its meaning."""

    draw: Icon
    words: str

    @property
    def width(self) -> float:
        """Its width [px], with the room to the next one."""
        return _ICON_PX + text_width(self.words, _WORDS_PX) + _GAP_PX


def legend_rows(scene: PicturedCase, width: Px) -> list[list[LegendEntry]]:
    """The entries for what a case's picture shows, in rows no wider than `width` [px]."""
    rows: list[list[LegendEntry]] = [[]]
    for entry in _entries(scene):
        if rows[-1] and sum(one.width for one in rows[-1]) + entry.width - _GAP_PX > width:
            rows.append([])
        rows[-1].append(entry)
    return rows


def draw_legend(canvas: Canvas, rows: list[list[LegendEntry]], left: Px, top: Px) -> None:
    """Draw the rows, from the point at the upper left on."""
    for number, row in enumerate(rows):
        x, middle = left, top + (number + 0.5) * LINE_PX
        for entry in row:
            entry.draw(canvas, x, middle)
            canvas.text((x + _ICON_PX, middle + 4.5), entry.words, _WORDS_PX, INK)
            x += entry.width


def _entries(scene: PicturedCase) -> Iterator[LegendEntry]:
    scenario, adversary = scene.scenario, next((i for i in scene.main if i), None)
    yield LegendEntry(_body(EGO), "ego")
    if adversary is not None:
        on_foot = scenario.agents[adversary].kind == "pedestrian"
        yield LegendEntry(_body(ADVERSARY), "adversary, on foot" if on_foot else "adversary")
    yield LegendEntry(_body(OTHER), "other traffic")
    yield LegendEntry(_path, "path, a dot each second")
    if scenario.log is not None:
        yield LegendEntry(_dashes(*scene.main.values()), "without the attack")
    if scene.careful is not None:
        yield LegendEntry(_dashes(EVASION), "careful driver")
    marks = {mark.kind: scene.mark_colour(mark) for mark in scene.marks}
    if "gives_way" in marks:
        yield LegendEntry(_teeth, "give way")
    if (colour := marks.get("breaks_rule")) is not None:
        yield LegendEntry(partial(_cross, colour), "breaks a rule")
    if (colour := marks.get("is_seen")) is not None:
        yield LegendEntry(partial(_ring, colour), "seen")
    thought = scene.debug.values()
    if any(len(one.candidates) for one in thought):
        yield LegendEntry(partial(_line, mix(PANEL, SECOND, 0.5), 1.2), "path that the planner weighs")
    if any(one.chosen is not None for one in thought):
        yield LegendEntry(partial(_line, SECOND, 3.0), "path that it takes")
    if any(len(one.predictions) for one in thought):
        yield LegendEntry(_expected, "path that it expects")
    if scenario.signals:
        yield LegendEntry(_lights, "traffic light")
    if scene.collision is not None:
        yield LegendEntry(lambda canvas, x, y: draw_burst(canvas, np.array([x + 12, y]), 7.0), "collision")


def _body(colour: Colour) -> Icon:
    def draw(canvas: Canvas, x: Px, y: Px) -> None:
        canvas.box(x, y - 5, x + 20, y + 5, shade(colour))
        canvas.box(x + 1, y - 4, x + 19, y + 4, colour)

    return draw


def _dashes(colour: Colour, below: Colour | None = None) -> Icon:
    def draw(canvas: Canvas, x: Px, y: Px) -> None:
        for line, one in ((y - 2, colour), (y + 2, below)) if below else ((y, colour),):
            canvas.dashed(np.array([[x - 4.0, line], [x + 6.0, line]]), mix(PANEL, one or colour, 0.8), 1.5, (4.0, 2.0))
        box = np.array([[x + 6, y - 5], [x + 23, y - 5], [x + 23, y + 5], [x + 6, y + 5], [x + 6, y - 5]])
        canvas.dashed(box, colour, 1.5, (4.0, 3.0))

    return draw


def _path(canvas: Canvas, x: Px, y: Px) -> None:
    canvas.line(np.array([[x, y], [x + 22.0, y]]), mix(PANEL, EGO, 0.6), 3.0)
    draw_second(canvas, np.array([x + 11.0, y]), EGO)


def _cross(colour: Colour, canvas: Canvas, x: Px, y: Px) -> None:
    draw_rule_broken(canvas, np.array([x + 12.0, y]), colour)


def _ring(colour: Colour, canvas: Canvas, x: Px, y: Px) -> None:
    draw_seen(canvas, np.array([x + 12.0, y]), colour)


def _line(colour: Colour, width: float, canvas: Canvas, x: Px, y: Px) -> None:
    canvas.line(np.array([[x, y], [x + 22.0, y]]), colour, width)


def _expected(canvas: Canvas, x: Px, y: Px) -> None:
    canvas.dashed(np.array([[x, y], [x + 22.0, y]]), FAINT_INK, 1.5, (3.0, 3.0))


def _teeth(canvas: Canvas, x: Px, y: Px) -> None:
    for left in (x + 1.0, x + 12.0):
        draw_tooth(canvas, np.array([[left, y - 4.5], [left + 9.0, y - 4.5], [left + 4.5, y + 4.5]]), INK)


def _lights(canvas: Canvas, x: Px, y: Px) -> None:
    for number, colour in enumerate((SIGNAL_RED, SIGNAL_AMBER, SIGNAL_GREEN)):
        canvas.box(x + 7 * number, y - 4, x + 7 * number + 6, y + 4, colour)
