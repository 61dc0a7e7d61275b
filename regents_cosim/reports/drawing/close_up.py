"""Draws the moment of contact, enlarged, in a free corner of a still picture."""

import itertools
from dataclasses import replace

import numpy as np
import shapely
from jaxtyping import Bool, Float

from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.reports.drawing.camera import View, centred
from regents_cosim.reports.drawing.canvas import Canvas
from regents_cosim.reports.drawing.palette import FAINT_INK, INK, PANEL
from regents_cosim.reports.drawing.pictured_case import PicturedCase, draw_ground, draw_moving
from regents_cosim.reports.drawing.texts.labels import Box

_SIZE = (330, 240)  # [px]
_EDGE_PX = 18
_PX_PER_M = 20.0
_LEAST_GAIN = 1.7  # least magnification compared with the picture; less shows nothing new


def draw_close_up(scene: PicturedCase, picture: Canvas, view: View, step: int) -> list[Box]:
    """Add the close-up, unless all corners are needed for the subject, and return what it fills [px]."""
    contact = scene.contact_point
    if contact is None or view.px_per_m * _LEAST_GAIN > _PX_PER_M:
        return []
    close = centred(contact, _PX_PER_M, _SIZE)
    left, bottom, right, top = close.bounds()
    marked = _rectangle(view.pixels(np.array([left, top])), view.pixels(np.array([right, bottom])))
    points = scene.main_points()[: step + 1].reshape(-1, 2)
    kept_free = np.concatenate([view.pixels(points[np.isfinite(points).all(axis=1)]), marked])
    corner = _free_corner(scene.scenario.road, view, kept_free)
    if corner is None:
        return []
    canvas = draw_ground(scene, close, picture.zoom)
    draw_moving(scene, canvas, close, step)
    picture.outline(marked, FAINT_INK, 1.0)
    picture.paste(canvas, *corner)
    frame = _rectangle(np.array(corner, float), np.add(corner, _SIZE).astype(float))
    picture.outline(frame, PANEL, 6.0)
    picture.outline(frame, FAINT_INK, 1.4)
    picture.text((corner[0] + 8, corner[1] + 18), "close-up of the collision", 12, INK, halo=PANEL)
    return [(*corner, *np.add(corner, _SIZE).tolist())]


def _free_corner(road: RoadMap, view: View, points: Float[np.ndarray, "point 2"]) -> tuple[int, int] | None:
    """The corner that covers none of `points` [px] and the least road; None where there is none."""
    far_x, far_y = view.width - _EDGE_PX - _SIZE[0], view.height - _EDGE_PX - _SIZE[1]
    corners = itertools.product((_EDGE_PX, far_x), (_EDGE_PX, far_y))
    free = [corner for corner in corners if not _inside(points, corner).any()]
    return min(free, key=lambda corner: _covered_road(road, view, corner), default=None)


def _inside(points: Float[np.ndarray, "point 2"], corner: tuple[int, int]) -> Bool[np.ndarray, " point"]:
    return np.all((points >= corner) & (points <= np.add(corner, _SIZE)), axis=1)


def _covered_road(road: RoadMap, view: View, corner: tuple[int, int]) -> int:
    """Drivable area behind a close-up in `corner`, in whole square metres, so that equal areas compare as equal."""
    there = replace(view.shifted(*corner), width=_SIZE[0], height=_SIZE[1])
    return round(shapely.clip_by_rect(road.drivable, *there.bounds()).area)


def _rectangle(first: Float[np.ndarray, " 2"], last: Float[np.ndarray, " 2"]) -> Float[np.ndarray, "4 2"]:
    return np.array([first, [last[0], first[1]], last, [first[0], last[1]]])
