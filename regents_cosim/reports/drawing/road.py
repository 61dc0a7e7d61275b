"""Draws the road: surface, sidewalks, crossings, lane markings, stop lines with their lights."""

import itertools
from collections.abc import Iterator

import numpy as np
import shapely
from jaxtyping import Float
from shapely.geometry.base import BaseGeometry
from shapely.ops import substring

from regents_cosim.maps.roadmap import Connection, Lane, RoadMap
from regents_cosim.maps.walkways import Walkway
from regents_cosim.reports.drawing.camera import View
from regents_cosim.reports.drawing.canvas import Canvas
from regents_cosim.reports.drawing.palette import (
    KERB,
    LAND,
    MARKING,
    PAVEMENT,
    ROAD,
    SIGNAL_AMBER,
    SIGNAL_GREEN,
    SIGNAL_OFF,
    SIGNAL_RED,
    Colour,
    shade,
)
from regents_cosim.scenario.scenario import Signal

_AROUND_M = 5.0  # drawn beyond the edge of a view, so that no outline is visible there
MARKING_M = 0.16
DASH_M, GAP_M = 3.0, 4.5
_INSET_M = 0.25  # of solid lines, so that the edge of the road stays visible
_BAR_M = 0.9  # length of a stop bar along the road
STRIPE_M = 0.5  # width of a crossing's stripe, and of the gap to the next
_LIGHTS: dict[str, Colour] = {
    "r": SIGNAL_RED, "s": SIGNAL_RED,
    "y": SIGNAL_AMBER, "Y": SIGNAL_AMBER, "u": SIGNAL_AMBER,
    "g": SIGNAL_GREEN, "G": SIGNAL_GREEN,
}  # fmt: skip


def draw_road(canvas: Canvas, view: View, road: RoadMap) -> None:
    """Draw everything static onto the canvas."""
    area = shapely.clip_by_rect(road.drivable, *view.bounds(_AROUND_M))
    parts = sorted(polygons(area), key=lambda part: part.area, reverse=True)  # islands in a hole come last
    for polygon in parts:
        _draw_polygon(canvas, view, polygon, ROAD)
    _draw_walkways(canvas, view, road)
    for lane in _visible(road, view):
        if not lane.junction:
            _draw_markings(canvas, view, lane)


def draw_signals(canvas: Canvas, view: View, road: RoadMap, signals: tuple[Signal, ...], step: int) -> None:
    """Draw a bar at the end of every signalled lane, one part per connection, in SUMO's order from the right."""
    letters = {signal.id: signal.letters(step) for signal in signals}
    for lane in _visible(road, view):
        lights = [_LIGHTS.get(letter, SIGNAL_OFF) for letter in _shown(road.exits[lane.id], letters)]
        if lights:
            _draw_bar(canvas, view, lane, lights)


def polygons(area: BaseGeometry) -> Iterator[shapely.Polygon]:
    """The polygons that `area` consists of."""
    for part in shapely.get_parts(area):
        if isinstance(part, shapely.Polygon):
            yield part
        elif hasattr(part, "geoms"):
            yield from polygons(part)


def _draw_polygon(canvas: Canvas, view: View, polygon: shapely.Polygon, surface: Colour) -> None:
    for ring, fill in [(polygon.exterior, surface), *((hole, LAND) for hole in polygon.interiors)]:
        points = view.pixels(shapely.get_coordinates(ring))
        canvas.polygon(points, fill)
        canvas.outline(points[:-1], KERB, 1.0)


def _draw_walkways(canvas: Canvas, view: View, road: RoadMap) -> None:
    near = shapely.box(*view.bounds(_AROUND_M))
    for walkway in road.walkways:
        if not walkway.area.intersects(near):
            continue
        if walkway.kind == "crossing":
            for stripe in stripes(walkway):
                canvas.polygon(view.pixels(stripe), MARKING)
        else:
            for polygon in polygons(shapely.intersection(walkway.area, near)):
                _draw_polygon(canvas, view, polygon, PAVEMENT)


def stripes(crossing: Walkway) -> list[Float[np.ndarray, "corner 2"]]:
    """The stripes of a crossing [m], each as wide as the crossing, in the walking direction."""
    line = crossing.line
    count = max(round((line.length + STRIPE_M) / (2 * STRIPE_M)), 1)
    begins = 0.5 * (line.length - (2 * count - 1) * STRIPE_M) + 2 * STRIPE_M * np.arange(count)
    parts = (substring(line, max(begin, 0.0), min(begin + STRIPE_M, line.length)) for begin in begins.tolist())
    return [
        shapely.get_coordinates(one)
        for part in parts
        for one in polygons(part.buffer(0.5 * crossing.width, cap_style="flat"))
    ]


def _visible(road: RoadMap, view: View) -> list[Lane]:
    """The lanes near the view, in the map's order."""
    found = road.centre_lines.query(shapely.box(*view.bounds(_AROUND_M)))
    return [road.lanes[index] for index in np.sort(found)]


# --- markings ---------------------------------------------------------------------------------


def _draw_markings(canvas: Canvas, view: View, lane: Lane) -> None:
    width = max(MARKING_M * view.px_per_m, 1.0)
    dashed, solid = markings(lane)
    for line in dashed:
        canvas.dashed(view.pixels(line), MARKING, width, (DASH_M * view.px_per_m, GAP_M * view.px_per_m))
    for line in solid:
        canvas.line(view.pixels(line), MARKING, width)


def markings(lane: Lane) -> tuple[list[Float[np.ndarray, "point 2"]], list[Float[np.ndarray, "point 2"]]]:
    """The lines beside a lane [m]: dashed where lane changes are allowed, solid elsewhere."""
    dashed = [] if lane.left is None else [_beside(lane, 0.5 * lane.width)]
    sides = [side for side, neighbour in ((1.0, lane.left), (-1.0, lane.right)) if neighbour is None]
    return dashed, [_beside(lane, side * (0.5 * lane.width - _INSET_M)) for side in sides]


def _beside(lane: Lane, left_m: float) -> Float[np.ndarray, "point 2"]:
    """The centre line, moved by `left_m` [m] to the left."""
    return lane.centre + left_m * _normals(lane.centre)


def _normals(points: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "point 2"]:
    """The vector of one metre to the left at each point, mitred at corners."""
    ways = np.diff(points, axis=0)
    length = np.hypot(*ways.T)[:, None]
    ways = ways / np.where(length > 0, length, 1.0)
    turned = np.stack([-ways[:, 1], ways[:, 0]], axis=-1)
    both = np.concatenate([turned[:1], turned[:-1] + turned[1:], turned[-1:]])
    both[1:-1] /= np.maximum((both[1:-1] * turned[1:]).sum(axis=1, keepdims=True), 0.5)
    return both


# --- lights -----------------------------------------------------------------------------------


def lights_of(exits: tuple[Connection, ...]) -> list[tuple[str, int]]:
    """(signal, index of its letter) of the connections of a lane, in SUMO's order from the right."""
    return sorted({(link.signal, link.link) for link in exits if link.signal is not None})


def _shown(exits: tuple[Connection, ...], letters: dict[str, str]) -> list[str]:
    links = [(signal, link) for signal, link in lights_of(exits) if signal in letters]
    return [letters[signal][link] for signal, link in links if link < len(letters[signal])]


def _draw_bar(canvas: Canvas, view: View, lane: Lane, lights: list[Colour]) -> None:
    whole, *parts = stop_bar(lane, len(lights))
    canvas.outline(view.pixels(whole), shade(SIGNAL_OFF), 2.0)
    for part, colour in zip(parts, lights, strict=True):
        canvas.polygon(view.pixels(part), colour)


def stop_bar(lane: Lane, lights: int) -> list[Float[np.ndarray, "4 2"]]:
    """The bar at the end of a lane [m] as a whole, then one part per light."""
    ahead = lane.centre[-1] - lane.centre[-2]
    ahead = ahead / max(float(np.hypot(*ahead)), 1e-9)
    left = np.array([-ahead[1], ahead[0]])
    cuts = np.linspace(-0.42, 0.42, lights + 1) * lane.width
    corners = [(cuts[0], cuts[-1]), *itertools.pairwise(cuts)]
    return [
        lane.centre[-1] + np.array([a * left, b * left, b * left - _BAR_M * ahead, a * left - _BAR_M * ahead])
        for a, b in corners
    ]
