"""Draws lines over an even axis: a training over its epochs, or a share over a threshold."""

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from regents_cosim.reports.drawing.canvas import Canvas, png_bytes
from regents_cosim.reports.drawing.palette import (
    ADVERSARY,
    EGO,
    EVASION,
    FAINT_INK,
    HAIRLINE,
    INK,
    OTHER,
    PANEL,
    SECOND,
    SIGNAL_AMBER,
)
from regents_cosim.system.files.output_files import write_output_file

_SIZE = (720, 400)
_LEFT, _TOP, _RIGHT, _BOTTOM = 64, 56, 24, 44  # margins [px]
_COLOURS = (EGO, ADVERSARY, OTHER, EVASION, SECOND, SIGNAL_AMBER, INK)
_TICKS = 4
_ZOOM = 2


def draw_curve(title: str, lines: Mapping[str, Sequence[float]], places: Sequence[str], path: Path) -> None:
    """Write a PNG of `lines`, each with a value for every one of `places`, on an axis that begins at 0."""
    canvas = Canvas.blank(_SIZE, _ZOOM, PANEL)
    canvas.text((_LEFT, 24), title, 15, INK, bold=True)
    last = max(len(places) - 1, 1)
    highest = 1.05 * max(max(values) for values in lines.values()) or 1.0
    for tick in range(_TICKS + 1):
        value = highest * tick / _TICKS
        _, y = _place(0.0, value / highest)
        canvas.line(np.array([[_LEFT, y], [_SIZE[0] - _RIGHT, y]]), HAIRLINE, 1)
        canvas.text((_LEFT - 8, y + 4), f"{value:.2g}", 11, FAINT_INK, anchor="rs")
    for place in sorted({0, (len(places) - 1) // 2, len(places) - 1}):
        x, y = _place(place / last, 0.0)
        canvas.text((x, y + 18), places[place], 11, FAINT_INK, anchor="ms")
    name_x = float(_LEFT)
    for (name, values), colour in zip(lines.items(), itertools.cycle(_COLOURS), strict=False):
        name_x += canvas.text((name_x, 46), name, 12, colour) + 20
        share = np.arange(len(values)) / last
        points = np.array([_place(x, y / highest) for x, y in zip(share, values, strict=True)])
        canvas.line(points, colour, 2)
        for point in points:
            canvas.disc(point, 2.5, colour)
    write_output_file(path, png_bytes(canvas.finish()))


def _place(across: float, up: float) -> Float[np.ndarray, " 2"]:
    """The pixel of a point given as shares of the axes."""
    width, height = _SIZE[0] - _LEFT - _RIGHT, _SIZE[1] - _TOP - _BOTTOM
    return np.array([_LEFT + across * width, _SIZE[1] - _BOTTOM - up * height])
