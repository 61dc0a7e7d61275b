"""Draw the figure of how it works, for README and documentation: python docs/draw_how_it_works.py."""

from pathlib import Path

import numpy as np

from regents_cosim.reports.drawing.canvas import Canvas, png_bytes
from regents_cosim.reports.drawing.palette import ADVERSARY, EGO, FAINT_INK, HAIRLINE, INK, OTHER, PANEL, Colour
from regents_cosim.system.files.output_files import write_output_file

_SIZE = (940, 302)
_WIDE, _HIGH, _GAP, _LEFT = 156, 140, 28, 24
_TOP = 80
_STAGES: tuple[tuple[str, Colour, tuple[str, ...]], ...] = (
    ("Record", OTHER, ("windows of 8 s", "from SUMO,", "highway-env, logs", "SUMO: own process")),
    ("Search", EGO, ("differentiable", "mirror in JAX,", "the planner drives", "in the loop")),
    ("Judge", EGO, ("clean? lawful?", "would a careful", "driver avoid it?", "whose fault?")),
    ("Verify", ADVERSARY, ("the same tracks in", "SUMO, highway-env;", "exact test of boxes", "SUMO: own process")),
    ("Use", OTHER, ("replay and watch", "pytest in CI", "report in a browser", "export, train")),
)
_FLOWS = ("scenario", "crash", "verdict", "case")


def draw() -> bytes:
    """The figure, as a PNG."""
    canvas = Canvas.blank(_SIZE, 2, PANEL)
    canvas.text((_LEFT, 30), "From ordinary traffic to a crash test", 17, INK, bold=True)
    for number, (title, colour, lines) in enumerate(_STAGES):
        left = _LEFT + number * (_WIDE + _GAP)
        canvas.box(left, _TOP, left + _WIDE, _TOP + _HIGH, HAIRLINE)
        canvas.box(left, _TOP, left + _WIDE, _TOP + 30, colour)
        canvas.text((left + 10, _TOP + 21), f"{number + 1}  {title}", 15, PANEL, bold=True)
        for place, line in enumerate(lines):
            canvas.text((left + 10, _TOP + 54 + 22 * place), line, 13, INK)
        if number < len(_FLOWS):
            _arrow(canvas, (left + _WIDE + 3, _TOP + _HIGH / 2), (left + _WIDE + _GAP - 3, _TOP + _HIGH / 2))
            canvas.text((left + _WIDE + _GAP / 2, _TOP - 10), _FLOWS[number], 13, FAINT_INK, "ms")
    middle = _LEFT + _WIDE + _GAP + _WIDE / 2
    _box_below(canvas, middle, "planner under test", "compiled in, or in its own process")
    _arrow(canvas, (middle - 14, _TOP + _HIGH + 3), (middle - 14, 248))
    _arrow(canvas, (middle + 14, 248), (middle + 14, _TOP + _HIGH + 3))
    canvas.text((middle - 22, 238), "what it sees", 12, FAINT_INK, "rs")
    canvas.text((middle + 22, 238), "how it drives", 12, FAINT_INK)
    return png_bytes(canvas.image)


def _box_below(canvas: Canvas, middle: float, title: str, words: str) -> None:
    canvas.box(middle - 116, 251, middle + 116, 294, HAIRLINE)
    canvas.text((middle, 269), title, 14, INK, "ms", bold=True)
    canvas.text((middle, 286), words, 12, FAINT_INK, "ms")


def _arrow(canvas: Canvas, start: tuple[float, float], end: tuple[float, float]) -> None:
    points = np.array([start, end], float)
    way = np.diff(points, axis=0)[0] / np.linalg.norm(np.diff(points, axis=0))
    side = np.array([-way[1], way[0]])
    canvas.line(points - np.array([[0.0, 0.0], 6 * way]), FAINT_INK, 2)
    canvas.polygon(np.array([points[1], points[1] - 9 * way + 5 * side, points[1] - 9 * way - 5 * side]), FAINT_INK)


if __name__ == "__main__":
    write_output_file(Path(__file__).with_name("how-it-works.png"), draw())
