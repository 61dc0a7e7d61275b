"""Draws road users from above, as boxes with a visible front, and the trails behind them."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from regents_cosim.reports.drawing.camera import View
from regents_cosim.reports.drawing.canvas import Canvas
from regents_cosim.reports.drawing.palette import INK, MARKING, PANEL, ROAD, Colour, mix, shade
from regents_cosim.scenario.scenario import Agent

Pose = tuple[float, float, float]  # centre [m], yaw [rad]

_TRAIL_PX = 3.0
_TAIL_PX = 2.0
_FAINTEST, _STRONGEST = 0.25, 0.75  # opacity of the oldest and newest part of a trail
_DETAIL_PX = 9.0  # narrower vehicles have no windows
_GLASS: Colour = mix(INK, MARKING, 0.82)
_LEAST_PX = 5.5  # a person is drawn no smaller, or it would not be seen
_ARC = np.deg2rad(np.linspace(0.0, 90.0, 6))


def draw_vehicle(canvas: Canvas, view: View, agent: Agent, pose: Pose, colour: Colour, outstanding: bool) -> None:
    """Draw one road user; `outstanding` ones have a light rim that sets them off from the others."""
    agent = _visible(agent, view)
    body = _placed(_body(agent), pose, view)
    if outstanding:
        canvas.outline(body, PANEL, 4.0)
    canvas.polygon(body, colour)
    canvas.outline(body, shade(colour), 1.2)
    if agent.width * view.px_per_m >= _DETAIL_PX:
        for window in _windows(agent):
            canvas.polygon(_placed(window, pose, view), _GLASS)
    else:
        canvas.polygon(_placed(_nose(agent), pose, view), _GLASS)


def draw_ghost(canvas: Canvas, view: View, agent: Agent, pose: Pose, colour: Colour) -> None:
    """Draw only the dashed outline of where a road user would have been."""
    shape = _placed(_body(_visible(agent, view)), pose, view)
    canvas.dashed(np.concatenate([shape, shape[:1]]), colour, 1.5, (4.0, 3.0))


def _visible(agent: Agent, view: View) -> Agent:
    if agent.kind != "pedestrian":
        return agent
    scale = max(_LEAST_PX / (view.px_per_m * min(agent.length, agent.width)), 1.0)
    return replace(agent, length=scale * agent.length, width=scale * agent.width)


def draw_trail(
    canvas: Canvas,
    view: View,
    points: Float[np.ndarray, "time 2"],
    valid: Bool[np.ndarray, " time"],
    colour: Colour,
    until: int,
) -> None:
    """Draw the path up to step `until`, fainter towards the start of the scene.

    Its shades do not depend on `until`, so that in an animation only its tip changes.
    """
    pixels = view.pixels(points)
    for step in range(until):
        if valid[step] and valid[step + 1]:
            share = _FAINTEST + (_STRONGEST - _FAINTEST) * step / max(len(points) - 1, 1)
            canvas.line(pixels[step : step + 2], mix(ROAD, colour, share), _TRAIL_PX)


def draw_tail(canvas: Canvas, view: View, points: Float[np.ndarray, "time 2"], colour: Colour) -> None:
    """Draw the last bit of the path, which shows who moves, and how fast."""
    canvas.line(view.pixels(points), mix(ROAD, colour, 0.5), _TAIL_PX)


def draw_planned_way(
    canvas: Canvas, view: View, points: Float[np.ndarray, "time 2"], valid: Bool[np.ndarray, " time"], colour: Colour
) -> None:
    """Draw a path that was not taken, as thin dashes."""
    edges = np.flatnonzero(np.diff(valid.astype(int), prepend=0, append=0))
    for first, end in edges.reshape(-1, 2):
        if end - first >= 2:
            canvas.dashed(view.pixels(points[first:end]), colour, 1.3, (6.0, 4.0))


# --- shapes in the frame of the vehicle: x ahead, y left [m] ----------------------------------


def _body(agent: Agent) -> Float[np.ndarray, "point 2"]:
    """The outline of the box with rounded corners, rounder at the front."""
    half = 0.5 * np.array([agent.length, agent.width])
    round_m = 0.5 * agent.width if agent.kind in ("bicycle", "pedestrian", "motorcycle") else 0.22 * agent.width
    front, rear = min(1.45 * round_m, half.min()), min(round_m, half.min())
    quarter = np.stack([np.cos(_ARC), np.sin(_ARC)], axis=-1)
    left_front = half - front + front * quarter
    left_rear = (half - rear + rear * quarter[::-1]) * [-1.0, 1.0]
    left = np.concatenate([left_front, left_rear])
    return np.concatenate([left, left[::-1] * [1.0, -1.0]])


def _windows(agent: Agent) -> list[Float[np.ndarray, "point 2"]]:
    """The windscreen; on long vehicles right behind the front."""
    half, side = 0.5 * agent.length, 0.5 * agent.width
    if agent.kind in ("bicycle", "pedestrian", "motorcycle"):
        return [_nose(agent)]
    if agent.kind in ("truck", "bus") or agent.length > 7.0:
        return [_pane(half - 0.45, half - 1.25, 0.80 * side, 0.80 * side)]
    return [_pane(0.50 * half, 0.12 * half, 0.82 * side, 0.66 * side)]


def _pane(front: float, rear: float, half_front: float, half_rear: float) -> Float[np.ndarray, "point 2"]:
    return np.array([[front, half_front], [front, -half_front], [rear, -half_rear], [rear, half_rear]])


def _nose(agent: Agent) -> Float[np.ndarray, "point 2"]:
    """An arrowhead, for boxes too small to have windows."""
    half, side = 0.5 * agent.length, 0.5 * agent.width
    return np.array([[0.75 * half, 0.0], [0.1 * half, 0.6 * side], [0.1 * half, -0.6 * side]])


def _placed(shape: Float[np.ndarray, "point 2"], pose: Pose, view: View) -> Float[np.ndarray, "point 2"]:
    x, y, yaw = pose
    turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    return view.pixels(shape @ turn + [x, y])
