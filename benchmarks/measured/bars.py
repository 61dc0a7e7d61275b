"""Draws a bar chart of percentages with their intervals, group by group."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from regents_cosim.reports.drawing.canvas import Canvas, png_bytes, text_width
from regents_cosim.reports.drawing.palette import ADVERSARY, EGO, FAINT_INK, HAIRLINE, INK, OTHER, PANEL
from regents_cosim.system.files.output_files import write_output_file

_LEFT, _TOP, _RIGHT, _BOTTOM = 56, 72, 24, 44  # margins [px]
_HEIGHT = 360
_BAR, _GAP, _GROUP_GAP = 22, 4, 34  # [px]
_COLOURS = (OTHER, EGO, ADVERSARY)
_ZOOM = 2


class PercentWithInterval(NamedTuple):
    """A percentage with the ends of its interval."""

    percent: float
    low: float
    high: float


def draw_bars(
    title: str, names: Sequence[str], groups: Mapping[str, Sequence[PercentWithInterval]], path: Path
) -> None:
    """Write a PNG with a group of up to three bars, called `names`, for every entry of `groups`."""
    wide = len(names) * (_BAR + _GAP) + _GROUP_GAP
    size = (max(_LEFT + _RIGHT + wide * len(groups), 480), _HEIGHT)
    canvas = Canvas.blank(size, _ZOOM, PANEL)
    canvas.text((16, 26), title, 15, INK, bold=True)
    x = 16.0
    for name, colour in zip(names, _COLOURS, strict=False):
        canvas.box(x, 42, x + 12, 54, colour)
        canvas.text((x + 18, 53), name, 12, INK)
        x += 18 + text_width(name, 12) + 20
    for percent in range(0, 101, 20):
        y = _height(float(percent))
        canvas.box(_LEFT, y - 0.5, size[0] - _RIGHT, y + 0.5, FAINT_INK if percent == 0 else HAIRLINE)
        canvas.text((_LEFT - 8, y + 4), f"{percent} %", 11, FAINT_INK, "rs")
    for number, (label, shares) in enumerate(groups.items()):
        left = _LEFT + _GROUP_GAP / 2 + number * wide
        for place, (share, colour) in enumerate(zip(shares, _COLOURS, strict=False)):
            start = left + place * (_BAR + _GAP)
            canvas.box(start, _height(share.percent), start + _BAR, _height(0.0), colour)
            middle = start + _BAR / 2
            canvas.line(np.array([[middle, _height(share.low)], [middle, _height(share.high)]]), INK, 1.5)
        canvas.text((left + (wide - _GROUP_GAP) / 2, _HEIGHT - _BOTTOM + 20), label, 12, INK, "ms")
    write_output_file(path, png_bytes(canvas.finish()))


def _height(percent: float) -> float:
    return _TOP + (_HEIGHT - _TOP - _BOTTOM) * (1.0 - percent / 100.0)
