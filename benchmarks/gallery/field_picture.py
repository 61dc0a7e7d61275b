"""The gradient field as a picture: steering on the left, throttle on the right, one row per heading."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from benchmarks.gallery.gradient_field import AHEAD_M, HELD_S, LEFT_M, SPEED_M_S, GradientField
from regents_cosim.attacks.accept.rules import FRONT_WINDOW_RAD, REAR_SECTOR_RAD
from regents_cosim.reports.drawing.camera import View, centred
from regents_cosim.reports.drawing.canvas import Canvas
from regents_cosim.reports.drawing.palette import (
    EGO,
    FAINT_INK,
    HAIRLINE,
    INK,
    LAND,
    OTHER,
    PANEL,
    SIGNAL_RED,
    Colour,
    mix,
)
from regents_cosim.reports.drawing.vehicles import draw_vehicle
from regents_cosim.scenario.scenario import Agent

_WIDTH_PX, _HEADER_PX, _STRIP_PX, _FOOTER_PX, _GAP_PX, _EDGE_PX = 1200, 74, 28, 78, 4, 16
_ZOOM = 3
_MARGIN_M = 6.5
_ARROW_M = 4.4
_STEPS = 12  # of a bent arrow
_SHARPEST_RAD = np.deg2rad(80.0)  # how far an arrow bends at most
_BENDS = 0.4  # of the greatest gradient: there an arrow bends by three quarters of that
_STRAIGHT_RAD = np.deg2rad(2.0)
_LEAST_M = 0.25  # shorter arrows are only a dot
_DASH_PX = (5.0, 4.0)
_FAR_M = 90.0  # zones reach beyond the picture

TOWARDS: Colour = (0, 128, 96)
AWAY: Colour = SIGNAL_RED
ACCELERATE: Colour = (52, 58, 150)
BRAKE: Colour = (176, 104, 0)
_RED_ZONE: Colour = mix(LAND, SIGNAL_RED, 0.2)
_REAR_SECTOR: Colour = mix(LAND, FAINT_INK, 0.16)


def draw_fields(fields: list[GradientField]) -> Canvas:
    """The whole picture, one row per field."""
    width = (_WIDTH_PX - _GAP_PX) // 2
    scale = width / (np.ptp(AHEAD_M) + 2 * _MARGIN_M)
    size = (width, round((np.ptp(LEFT_M) + 2 * _MARGIN_M) * scale))
    view = centred(np.zeros(2), scale, size)
    row_px = _STRIP_PX + size[1] + _GAP_PX
    canvas = Canvas.blank((_WIDTH_PX, _HEADER_PX + len(fields) * row_px + _FOOTER_PX), _ZOOM, HAIRLINE)
    canvas.paste(_header(width), 0, 0)
    for row, field in enumerate(fields):
        top = _HEADER_PX + row * row_px
        canvas.paste(_strip(field), 0, top)
        canvas.paste(_panel(field, view, _draw_steering), 0, top + _STRIP_PX)
        canvas.paste(_panel(field, view, _draw_throttle), width + _GAP_PX, top + _STRIP_PX)
    canvas.paste(_footer(), 0, _HEADER_PX + len(fields) * row_px)
    return canvas


# --- one panel --------------------------------------------------------------------------------


def _panel(field: GradientField, view: View, draw_arrows: Callable[[Canvas, View, GradientField], None]) -> Canvas:
    canvas = Canvas.blank((view.width, view.height), _ZOOM, LAND)
    half = 0.5 * REAR_SECTOR_RAD
    canvas.polygon(view.pixels(_wedge(np.pi - half, np.pi + half)), _REAR_SECTOR)
    if field.yaw and abs(field.yaw) < FRONT_WINDOW_RAD:
        canvas.polygon(view.pixels(_wedge(0.0, field.yaw)), _RED_ZONE)
    for bearing in (FRONT_WINDOW_RAD, -FRONT_WINDOW_RAD):
        canvas.dashed(view.pixels(_wedge(bearing, bearing)[:2]), mix(LAND, FAINT_INK, 0.6), 1.0, _DASH_PX)
    draw_arrows(canvas, view, field)
    draw_vehicle(canvas, view, Agent("ego", "car", 4.6, 1.8, "ego"), (0.0, 0.0, 0.0), EGO, True)
    return canvas


def _wedge(first: float, last: float) -> Float[np.ndarray, "point 2"]:
    """All bearings between two, from the ego outwards [m]."""
    bearings = np.linspace(first, last, 8)
    return np.concatenate([np.zeros((1, 2)), _FAR_M * np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)])


def _draw_steering(canvas: Canvas, view: View, field: GradientField) -> None:
    """Arrows of equal length that begin along the heading and bend to where descent steers."""
    bend = _SHARPEST_RAD * np.tanh(field.curvature / (_BENDS * np.abs(field.curvature).max()))
    for ahead, left, turn, away in zip(field.ahead, field.left, bend, field.leads_away, strict=True):
        headings = field.yaw + turn * (np.arange(_STEPS) + 0.5) / _STEPS
        moves = _ARROW_M / _STEPS * np.stack([np.cos(headings), np.sin(headings)], axis=-1)
        path = np.array([ahead, left]) + np.concatenate([np.zeros((1, 2)), moves.cumsum(axis=0)])
        colour = OTHER if abs(turn) < _STRAIGHT_RAD else AWAY if away else TOWARDS
        _draw_arrow(canvas, view.pixels(path), colour)


def _draw_throttle(canvas: Canvas, view: View, field: GradientField) -> None:
    """Straight arrows along the heading, or against it where descent brakes."""
    lengths = _ARROW_M * field.accel / np.abs(field.accel).max()
    along = np.array([np.cos(field.yaw), np.sin(field.yaw)])
    for ahead, left, length in zip(field.ahead, field.left, lengths, strict=True):
        start = np.array([ahead, left])
        if abs(length) < _LEAST_M:
            canvas.disc(view.pixels(start), 2.4, OTHER)
            continue
        path = np.stack([start, start + length * along])
        _draw_arrow(canvas, view.pixels(path), ACCELERATE if length > 0 else BRAKE)


def _draw_arrow(canvas: Canvas, path: Float[np.ndarray, "point 2"], colour: Colour) -> None:
    """A line from a dot to a head, in pixels."""
    canvas.line(path, colour, 1.8)
    canvas.disc(path[0], 2.4, colour)
    way = path[-1] - path[-2]
    way = way / max(float(np.hypot(*way)), 1e-9)
    side = np.array([-way[1], way[0]])
    canvas.polygon(np.array([path[-1] + 5.0 * way, path[-1] + 3.4 * side, path[-1] - 3.4 * side]), colour)


# --- words ------------------------------------------------------------------------------------


def _header(width: int) -> Canvas:
    canvas = Canvas.blank((_WIDTH_PX, _HEADER_PX), _ZOOM, PANEL)
    canvas.text((_EDGE_PX, 33), "What descent does to an adversary around the ego", 20, INK, bold=True)
    words = f"both drive at {SPEED_M_S:g} m/s, the ego to the right · controls held for {HELD_S:g} s"
    canvas.text((_WIDTH_PX - _EDGE_PX, 33), words, 13, FAINT_INK, "rs")
    canvas.text((_EDGE_PX, 62), "steering: minus gradient by curvature", 14, INK, bold=True)
    canvas.text((width + _GAP_PX + _EDGE_PX, 62), "throttle: minus gradient by acceleration", 14, INK, bold=True)
    return canvas


def _strip(field: GradientField) -> Canvas:
    canvas = Canvas.blank((_WIDTH_PX, _STRIP_PX), _ZOOM, PANEL)
    degrees = round(np.rad2deg(field.yaw))
    side = "left" if degrees > 0 else "right"
    words = f"adversary turned {abs(degrees)} degrees to the {side}" if degrees else "adversary turned as the ego"
    canvas.text((_EDGE_PX, 19), words, 13, FAINT_INK)
    return canvas


def _footer() -> Canvas:
    canvas = Canvas.blank((_WIDTH_PX, _FOOTER_PX), _ZOOM, PANEL)
    arrows = (
        (TOWARDS, "steers to the ego or into its lane"),
        (AWAY, "steers away from the ego's lane"),
        (ACCELERATE, "accelerates"),
        (BRAKE, "brakes"),
    )
    x = float(_EDGE_PX)
    for colour, words in arrows:
        _draw_arrow(canvas, np.array([[x + 3, 24.0], [x + 19, 24.0]]), colour)
        x = _write(canvas, x, 24.0, words)
    zones = (
        (_RED_ZONE, "red zone of rule 1: turned away to its own side, steering is cancelled"),
        (_REAR_SECTOR, "rear sector of rule 2: no candidates"),
    )
    x = float(_EDGE_PX)
    for colour, words in zones:
        canvas.box(x, 47, x + 24, 61, colour)
        x = _write(canvas, x, 54.0, words)
    canvas.dashed(np.array([[x, 54.0], [x + 24, 54.0]]), FAINT_INK, 1.0, _DASH_PX)
    _write(canvas, x, 54.0, "bearing of pi/8, where the red zone ends")
    return canvas


def _write(canvas: Canvas, x: float, y: float, words: str) -> float:
    """Words of the legend beside their sign; returns where the next sign may stand [px]."""
    return x + 34 + canvas.text((x + 34, y + 4.5), words, 13, INK) + 24
