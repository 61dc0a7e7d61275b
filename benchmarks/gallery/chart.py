"""Draws a small line chart on the canvas of the pictures."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from regents_cosim.reports.drawing.canvas import Canvas, text_width
from regents_cosim.reports.drawing.palette import FAINT_INK, HAIRLINE, INK, PANEL, Colour

_LEFT_PX, _RIGHT_PX, _TOP_PX, _BOTTOM_PX = 52, 20, 58, 34  # around the plot
_EDGE_PX = 16
_TICKS = 4  # approximate number of intervals on each axis
_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)  # between two ticks, times a power of ten
_DASH_PX = (5.0, 4.0)


@dataclass(frozen=True, eq=False)
class Line:
    """Values at equal distances on the horizontal axis, from 0 on."""

    label: str
    values: Float[np.ndarray, " point"]
    step: float  # between two values, in the unit of the horizontal axis
    colour: Colour
    width: float = 2.0  # [px]
    dashed: bool = False
    ends_in_contact: bool = False  # mark the last point


def draw_chart(title: str, axis: str, lines: Sequence[Line], size: tuple[int, int], zoom: int) -> Canvas:
    """Draw `lines` with a legend; the vertical axis begins at 0, `axis` names the horizontal one."""
    canvas = Canvas.blank(size, zoom, PANEL)
    canvas.text((_EDGE_PX, 24), title, 14, INK, bold=True)
    right = max(line.step * (len(line.values) - 1) for line in lines)
    top = max(float(line.values.max()) for line in lines)
    plot = _Plot(size, right, _ticks(top)[-1])
    _draw_axes(canvas, plot, axis, _ticks(right), _ticks(top))
    for line in lines:
        points = plot.pixels(line.step * np.arange(len(line.values)), line.values)
        _stroke(canvas, points, line)
        if line.ends_in_contact:
            canvas.disc(points[-1], 5.0, PANEL)
            canvas.disc(points[-1], 4.0, line.colour)
    _draw_legend(canvas, lines)
    return canvas


@dataclass(frozen=True)
class _Plot:
    size: tuple[int, int]  # [px] of the whole chart
    right: float  # greatest value on the horizontal axis
    top: float  # greatest value on the vertical axis

    def pixels(self, x: Float[np.ndarray, " point"], y: Float[np.ndarray, " point"]) -> Float[np.ndarray, "point 2"]:
        width, height = self.size[0] - _LEFT_PX - _RIGHT_PX, self.size[1] - _TOP_PX - _BOTTOM_PX
        across, up = x / max(self.right, 1e-9), y / max(self.top, 1e-9)
        return np.stack([_LEFT_PX + width * across, self.size[1] - _BOTTOM_PX - height * up], axis=-1)


def _draw_axes(canvas: Canvas, plot: _Plot, axis: str, along: list[float], up: list[float]) -> None:
    bottom = plot.size[1] - _BOTTOM_PX
    for value in up:
        y = plot.pixels(np.zeros(1), np.array([value]))[0, 1]
        canvas.box(_LEFT_PX, y - 0.5, plot.size[0] - _RIGHT_PX, y + 0.5, FAINT_INK if value == 0.0 else HAIRLINE)
        canvas.text((_LEFT_PX - 8, y + 4), f"{value:g}", 11, FAINT_INK, "rs")
    for value in along:
        if value <= plot.right:
            x = plot.pixels(np.array([value]), np.zeros(1))[0, 0]
            canvas.box(x - 0.5, bottom, x + 0.5, bottom + 4, FAINT_INK)
            canvas.text((x, bottom + 16), f"{value:g}", 11, FAINT_INK, "ms")
    canvas.text((plot.size[0] - _RIGHT_PX, bottom + 30), axis, 11, FAINT_INK, "rs")


def _draw_legend(canvas: Canvas, lines: Sequence[Line]) -> None:
    x = float(_EDGE_PX)
    for line in lines:
        _stroke(canvas, np.array([[x, 40.0], [x + 22.0, 40.0]]), line)
        canvas.text((x + 28, 44), line.label, 12, INK)
        x += 28 + text_width(line.label, 12) + 18


def _stroke(canvas: Canvas, points: Float[np.ndarray, "point 2"], line: Line) -> None:
    if line.dashed:
        canvas.dashed(points, line.colour, line.width, _DASH_PX)
    else:
        canvas.line(points, line.colour, line.width)


def _ticks(greatest: float) -> list[float]:
    """Round numbers from 0 to just above `greatest`."""
    rough = max(greatest, 1e-9) / _TICKS
    power = 10.0 ** np.floor(np.log10(rough))
    step = next(step * power for step in _STEPS if step * power >= rough * (1 - 1e-9))
    return [float(round(step * index, 9)) for index in range(int(np.ceil(greatest / step - 1e-9)) + 1)]
