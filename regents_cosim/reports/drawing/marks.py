"""Draws marks on the road: seconds on a path, where one gives way, breaks a rule, enters a lane or begins to brake."""

import numpy as np
from jaxtyping import Float

from regents_cosim.planners.interface import Debug
from regents_cosim.reports.drawing.camera import View
from regents_cosim.reports.drawing.canvas import Canvas
from regents_cosim.reports.drawing.palette import BURST, FAINT_INK, INK, PANEL, ROAD, SECOND, Colour, mix

DOT_PX = 3.5
_RING_PX = 7.0
_TOOTH_PX = 8.0  # least height of a triangle
_TOOTH_M = 1.0
_BAR_PX = 5.0  # how far a bar reaches beyond the road user


def draw_second(canvas: Canvas, at: Float[np.ndarray, " 2"], colour: Colour) -> None:
    """Draw the dot of a whole second on a path."""
    canvas.disc(at, DOT_PX, PANEL)
    canvas.disc(at, DOT_PX - 1.0, colour)


def draw_rule_broken(canvas: Canvas, at: Float[np.ndarray, " 2"], colour: Colour) -> None:
    """Draw the cross where a road user begins to break a rule."""
    for one, width in ((PANEL, 5.5), (colour, 2.5)):
        for way in ([1.0, 1.0], [1.0, -1.0]):
            reach = 5.0 * np.array(way)
            canvas.line(np.stack([at - reach, at + reach]), one, width)


def draw_seen(canvas: Canvas, at: Float[np.ndarray, " 2"], colour: Colour) -> None:
    """Draw the ring around the place of the adversary when a careful driver sees the danger."""
    canvas.ring(at, _RING_PX + 1.2, PANEL, 4.4)
    canvas.ring(at, _RING_PX, colour, 2.2)


def draw_give_way(
    canvas: Canvas, view: View, middle: Float[np.ndarray, " 2"], heading: float, width: float, colour: Colour
) -> None:
    """Draw triangles on a line across a lane [m], pointing to who comes along it and has to give way there."""
    ahead = np.array([np.cos(heading), np.sin(heading)])
    left = np.array([-ahead[1], ahead[0]])
    reach = max(_TOOTH_M, _TOOTH_PX / view.px_per_m)
    count = max(round(width / reach), 2)
    for offset in width * (np.arange(count) + 0.5) / count - 0.5 * width:
        base, half = middle + offset * left, 0.42 * width / count
        tooth = view.pixels(np.array([base + half * left, base - half * left, base - reach * ahead]))
        draw_tooth(canvas, tooth, colour)


def draw_tooth(canvas: Canvas, tooth: Float[np.ndarray, "3 2"], colour: Colour) -> None:
    """Draw one triangle of a line at which to give way [px]."""
    canvas.polygon(tooth, PANEL)
    canvas.outline(tooth, colour, 1.6)


def draw_bar(
    canvas: Canvas, view: View, middle: Float[np.ndarray, " 2"], heading: float, width: float, colour: Colour
) -> None:
    """Draw the bar across the path of one of a `width` [m] where it begins something."""
    left = np.array([-np.sin(heading), np.cos(heading)])
    reach = 0.5 * width + _BAR_PX / view.px_per_m
    ends = view.pixels(np.stack([middle - reach * left, middle + reach * left]))
    canvas.line(ends, PANEL, 6.0)
    canvas.line(ends, colour, 3.5)


def draw_debug(canvas: Canvas, view: View, debug: Debug) -> None:
    """Draw the paths that a planner weighed, the cheaper the stronger, those that it expects, and the chosen one."""
    cost = np.array(debug.costs) if len(debug.costs) else np.zeros(len(debug.candidates))
    rank = np.argsort(np.argsort(-cost, kind="stable"), kind="stable") / max(len(cost) - 1, 1)  # 1: the cheapest
    for k in np.argsort(rank, kind="stable").tolist():
        canvas.line(view.pixels(debug.candidates[k]), mix(ROAD, SECOND, 0.25 + 0.35 * float(rank[k])), 1.2)
    for path in debug.predictions:
        if len(path) > 1:
            canvas.dashed(view.pixels(path), FAINT_INK, 1.5, (3.0, 3.0))
    if debug.chosen is not None:
        canvas.line(view.pixels(debug.chosen), SECOND, 3.0)


_SPIKES = np.arange(16) * np.pi / 8
_STAR = np.stack([np.cos(_SPIKES), np.sin(_SPIKES)], axis=-1) * np.where(np.arange(16) % 2, 0.48, 1.0)[:, None]


def draw_burst(canvas: Canvas, at: Float[np.ndarray, " 2"], radius: float) -> None:
    """Draw the star that marks a collision."""
    canvas.polygon(at + (radius + 1.3) * _STAR, INK)
    canvas.polygon(at + radius * _STAR, BURST)
