"""Draws what stands under a picture: the story of the case, the legend and a scale."""

from regents_cosim.reports.drawing.camera import View
from regents_cosim.reports.drawing.canvas import Canvas, Px, text_width
from regents_cosim.reports.drawing.palette import HAIRLINE, INK, PANEL
from regents_cosim.reports.drawing.pictured_case import PicturedCase
from regents_cosim.reports.drawing.texts.caption import EDGE_PX, STORY_LINE_PX, STORY_PX, story_lines
from regents_cosim.reports.drawing.texts.legend import LINE_PX, draw_legend, legend_rows

_PAD_PX = 8
_SCALE_PX = 140  # room for the scale
_SCALES_M = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)


def footer_height(scene: PicturedCase, width: int) -> int:
    """The height of a picture's footer [px], given its width [px]."""
    rows = len(legend_rows(scene, _legend_width(width)))
    return 2 * _PAD_PX + STORY_LINE_PX * len(story_lines(scene, width)) + LINE_PX * rows


def draw_footer(scene: PicturedCase, view: View, width: int, zoom: int) -> Canvas:
    """Draw the story, the legend, and a scale of about ten metres."""
    canvas = Canvas.blank((width, footer_height(scene, width)), zoom, PANEL)
    canvas.box(0, 0, width, 1, HAIRLINE)
    lines = story_lines(scene, width)
    for number, line in enumerate(lines):
        canvas.text((EDGE_PX, _PAD_PX + number * STORY_LINE_PX + 15), line, STORY_PX, INK)
    top = _PAD_PX + STORY_LINE_PX * len(lines)
    draw_legend(canvas, legend_rows(scene, _legend_width(width)), EDGE_PX, top)
    _draw_scale(canvas, view, width, top + LINE_PX / 2)
    return canvas


def _legend_width(width: int) -> int:
    return width - 2 * EDGE_PX - _SCALE_PX


def _draw_scale(canvas: Canvas, view: View, width: int, middle: Px) -> None:
    metres = max(m for m in _SCALES_M if m * view.px_per_m <= 130 or m == 1)
    length = metres * view.px_per_m
    right, y = width - EDGE_PX, middle + 6.5
    for box in ((right - length, y - 1.5, right, y), (right - length, y - 6, right - length + 1.5, y)):
        canvas.box(*box, INK)
    canvas.box(right - 1.5, y - 6, right, y, INK)
    words = f"{metres} m"
    canvas.text((right - length / 2 - text_width(words, 12) / 2, y - 5), words, 12, INK)
