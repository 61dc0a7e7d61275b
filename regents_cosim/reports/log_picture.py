"""Draws a scene of a log as one picture: the road, every agent's path, and all agents halfway through."""

import re
from pathlib import Path

import numpy as np
from jaxtyping import Float

from regents_cosim.errors import LogError
from regents_cosim.reports.drawing.camera import View, fit
from regents_cosim.reports.drawing.canvas import Canvas, png_bytes
from regents_cosim.reports.drawing.palette import ADVERSARY, EGO, INK, LAND, OTHER, Colour, mix
from regents_cosim.reports.drawing.road import draw_road
from regents_cosim.reports.drawing.vehicles import draw_vehicle
from regents_cosim.sources.logs.inspection import moving_centres
from regents_cosim.sources.logs.roads.road import build_road
from regents_cosim.sources.logs.scene import LoggedScene, Track
from regents_cosim.system.files.output_files import write_output_file

_SIZE = (1200, 900)
_ZOOM = 2
_KEPT_PERCENT = (1.0, 99.0)  # share of all places that the view shows, so that a single stray track does not shrink it
_MOST_DOTS = 5000


def draw_scene(scene: LoggedScene, folder: Path) -> Path:
    """Write a PNG named like the scene; moving vehicles off the road have red dots.

    Raises RegentsError where it cannot be written.
    """
    view = fit(_shown(scene), _SIZE)
    canvas = Canvas.blank(_SIZE, _ZOOM, LAND)
    off = np.zeros((0, 2))
    try:
        road = build_road(scene)
        draw_road(canvas, view, road)
        centres, _ = moving_centres(scene)
        off = centres[~road.contains(centres)]
    except LogError:
        pass  # a log without a road
    ordered = sorted(scene.tracks, key=lambda track: track.agent.id == scene.ego)
    for track in ordered:
        _draw_way(canvas, view, track, EGO if track.agent.id == scene.ego else OTHER)
    for place in view.pixels(off[:: -(-len(off) // _MOST_DOTS) or 1]):
        canvas.ring(place, 1.5, ADVERSARY, 1.5)
    middle = (scene.first_step + scene.last_step) // 2
    for track in ordered:
        _draw_box(canvas, view, track, middle, track.agent.id == scene.ego)
    canvas.text((12, 24), f"{scene.name}: {len(scene.tracks)} road users, {scene.duration_s:g} s", 16, INK)
    path = folder / f"{re.sub(r'[^A-Za-z0-9._-]+', '_', scene.name)[:80]}.png"
    write_output_file(path, png_bytes(canvas.finish()))
    return path


def _shown(scene: LoggedScene) -> Float[np.ndarray, "point 2"]:
    every = np.concatenate([np.stack([track.x, track.y], axis=-1) for track in scene.tracks])
    least, greatest = np.percentile(every, _KEPT_PERCENT, axis=0)
    return np.stack([least, greatest])


def _draw_way(canvas: Canvas, view: View, track: Track, colour: Colour) -> None:
    points = view.pixels(np.stack([track.x, track.y], axis=-1))
    for piece in np.split(points, np.flatnonzero(np.diff(track.step) != 1) + 1):
        if len(piece) > 1:
            canvas.line(piece, mix(LAND, colour, 0.7), 1.5)


def _draw_box(canvas: Canvas, view: View, track: Track, step: int, is_ego: bool) -> None:
    at = int(np.searchsorted(track.step, step))
    if at < len(track.step) and abs(int(track.step[at]) - step) <= 1:
        pose = float(track.x[at]), float(track.y[at]), float(track.yaw[at])
        draw_vehicle(canvas, view, track.agent, pose, EGO if is_ego else OTHER, is_ego)
