"""Draws cases as pictures: a still PNG, an animated GIF, and two animations side by side."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image

from regents_cosim.cases.files import STILL
from regents_cosim.errors import RegentsError, require
from regents_cosim.planners.interface import DebugSteps
from regents_cosim.reports.drawing.camera import View, fit, fit_latest
from regents_cosim.reports.drawing.canvas import Canvas, Px, png_bytes, text_width
from regents_cosim.reports.drawing.close_up import draw_close_up
from regents_cosim.reports.drawing.film import Backdrop, frame_steps, gif_bytes, shoot
from regents_cosim.reports.drawing.palette import ADVERSARY, HAIRLINE, INK, PANEL
from regents_cosim.reports.drawing.pictured_case import PicturedCase, draw_ground, draw_moving
from regents_cosim.reports.drawing.texts.caption import (
    EDGE_PX,
    STORY_LINE_PX,
    STORY_PX,
    STRIP_PX,
    draw_header,
    draw_strip,
    header_height,
    story_lines,
)
from regents_cosim.reports.drawing.texts.labels import draw_labels
from regents_cosim.reports.drawing.texts.legend import LINE_PX, draw_legend, legend_rows
from regents_cosim.reports.drawing.texts.notes import draw_thought, film_notes, still_notes
from regents_cosim.scenario.collisions import first_contact
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.system.files.atomic import explain_write, write_atomic
from regents_cosim.system.files.output_files import write_output_file

STILL_SIZE = (1200, 800)  # [px]
GIF_SIZE = (900, 600)  # [px] at most

_ZOOM = 3  # drawn larger by this factor, then reduced
_STILL_PX_PER_M = 4.5  # a car is 22 px long
_BESIDE, _BELOW = (500, 460), (1000, 300)  # size [px] of each of two pictures
_GAP_PX = 4
_LEAST_HEIGHT_PX = 320  # between header and footer


def draw_still(scenario: Scenario, path: Path, debug: DebugSteps = ()) -> None:
    """Write `still` of a case to `path`. Raises RegentsError where it cannot be written."""
    write_output_file(path, still(scenario, debug))


def draw_into_case(scenario: Scenario, suite: Path) -> None:
    """Write `still` of a case into its folder, replacing only a picture of the case's own."""
    path = suite / scenario.id / STILL
    with explain_write(path.parent):
        write_atomic(path, still(scenario))


def still(scenario: Scenario, debug: DebugSteps = ()) -> bytes:
    """A PNG of the collision, or of the end where there is none, with the paths that led there."""
    return png_bytes(still_image(scenario, debug))


def still_image(scenario: Scenario, debug: DebugSteps = ()) -> Image.Image:
    """The picture of `still` as an image; `debug` is what the planner thought."""
    scene = PicturedCase.of(scenario, debug)
    step = scene.shown_step
    view = fit_latest(scene.main_points()[: step + 1], _inside(scene, STILL_SIZE), _STILL_PX_PER_M)
    picture = draw_ground(scene, view, _ZOOM)
    draw_moving(scene, picture, view, step)
    close_up = draw_close_up(scene, picture, view, step)
    draw_labels(picture, still_notes(scene, view, step, close_up))
    draw_thought(picture, scene, step)
    return _framed(picture, scene, view, step)


def animate(scenario: Scenario, path: Path, debug: DebugSteps = ()) -> None:
    """Write a GIF in real time that stops about 1 s after the collision, or at the end.

    `debug` is what the planner thought. Raises RegentsError where `path` cannot be written.
    """
    scene = PicturedCase.of(scenario, debug)
    views = shoot(scene.main_points(), scenario.dt, _inside(scene, GIF_SIZE), _LEAST_HEIGHT_PX)
    shown = _Film(scene, views)

    def frame(step: int) -> Image.Image:
        picture = shown.at(step)
        return _framed(picture, scene, views[step], step)

    frames = map(frame, frame_steps(scene.last_step, scenario.dt))
    write_output_file(path, gif_bytes(frames, scenario.dt))


def animate_pair(left: Scenario, right: Scenario, path: Path) -> None:
    """Write one GIF of two Scenarios on the same map, titled as before and after an attack.

    One camera follows both; they are side by side, or above each other where the scene is wide. The adversary of the
    right one is coloured in both, and the title describes the right one. Raises RegentsError as `animate` does, and
    where the time steps differ.
    """
    require(left.dt == right.dt, f"time steps of {left.dt:g} s and {right.dt:g} s, expected equal ones", RegentsError)
    after = PicturedCase.of(right)
    before = PicturedCase(left, after.adversary)
    last = min(before.last_step, after.last_step)
    points = np.concatenate([scene.main_points()[: last + 1] for scene in (before, after)], axis=1)
    size = _pair_size(points)
    views = shoot(points, right.dt, size, size[1])
    panels = [(_Film(scene, views), _draw_strip(scene, size[0])) for scene in (before, after)]
    right_px, down_px = (size[0] + _GAP_PX, 0) if size == _BESIDE else (0, STRIP_PX + size[1])

    def frame(step: int) -> Image.Image:
        body = Canvas.blank((size[0] + right_px, STRIP_PX + size[1] + down_px), _ZOOM, HAIRLINE)
        for index, (film, strip) in enumerate(panels):
            body.paste(strip, index * right_px, index * down_px)
            body.paste(film.at(step), index * right_px, index * down_px + STRIP_PX)
        return _framed(body, after, views[step], step)

    write_output_file(path, gif_bytes(map(frame, frame_steps(last, right.dt)), right.dt))


class _Film:
    """The pictures of one case at all steps, without what stands around them."""

    def __init__(self, scene: PicturedCase, views: Sequence[View]) -> None:
        self._scene, self._views = scene, views
        self._ground, self._notes = Backdrop(scene, views[0], _ZOOM), film_notes(scene, views)

    def at(self, step: int) -> Canvas:
        first, view = self._views[0], self._views[step]
        picture = self._ground.under(view)
        draw_moving(self._scene, picture, view, step)
        moved = (first.left - view.left) * view.px_per_m, (view.top - first.top) * view.px_per_m
        draw_labels(picture, [note.label for note in self._notes if step >= note.step], *moved)
        draw_thought(picture, self._scene, step)
        return picture


def _inside(scene: PicturedCase, size: tuple[int, int]) -> tuple[int, int]:
    """The size [px] of a picture without its header and footer."""
    return size[0], size[1] - header_height(scene, size[0]) - footer_height(scene, size[0])


def _framed(body: Canvas, scene: PicturedCase, view: View, step: int) -> Image.Image:
    """The `body` between header and footer, in its final size."""
    width, height = body.size
    top = header_height(scene, width)
    picture = Image.new("RGB", (width, top + height + footer_height(scene, width)), PANEL)
    picture.paste(draw_header(scene, step, width, _ZOOM).finish(), (0, 0))
    picture.paste(body.finish(), (0, top))
    picture.paste(draw_footer(scene, view, width, _ZOOM).finish(), (0, top + height))
    return picture


def _pair_size(points: Float[np.ndarray, "time agent 2"]) -> tuple[int, int]:
    """The size of each of two pictures in the arrangement that shows the scene larger."""
    flat = points.reshape(-1, 2)
    present = flat[np.isfinite(flat).all(axis=1)]
    return max((_BESIDE, _BELOW), key=lambda size: fit(present, size).px_per_m)


def _draw_strip(scene: PicturedCase, width: int) -> Canvas:
    """Draw the title of one of two pictures; the verdict is that of the exact boxes."""
    title = f"{'after' if scene.scenario.attack else 'before'} the attack"
    contact = first_contact(scene.scenario.agents, scene.scenario.tracks)
    end = "no collision" if contact is None else f"collision at {contact[1] * scene.scenario.dt:.1f} s"
    return draw_strip(f"{title}: {end}", INK if contact is None else ADVERSARY, width, _ZOOM)


_PAD_PX = 8
_SCALE_PX = 140  # room for the scale
_SCALES_M = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)


def footer_height(scene: PicturedCase, width: int) -> int:
    """The height of a picture's footer [px], given its width [px]."""
    rows = len(legend_rows(scene, _legend_width(width)))
    return 2 * _PAD_PX + STORY_LINE_PX * len(story_lines(scene, width)) + LINE_PX * rows


def draw_footer(scene: PicturedCase, view: View, width: int, zoom: int) -> Canvas:
    """Draw the story, the legend, and a scale of about ten metres."""
    canvas = Canvas.blank((width, footer_height(scene, width)), zoom, PANEL)
    canvas.box(0, 0, width, 1, HAIRLINE)
    lines = story_lines(scene, width)
    for number, line in enumerate(lines):
        canvas.text((EDGE_PX, _PAD_PX + number * STORY_LINE_PX + 15), line, STORY_PX, INK)
    top = _PAD_PX + STORY_LINE_PX * len(lines)
    draw_legend(canvas, legend_rows(scene, _legend_width(width)), EDGE_PX, top)
    _draw_scale(canvas, view, width, top + LINE_PX / 2)
    return canvas


def _legend_width(width: int) -> int:
    return width - 2 * EDGE_PX - _SCALE_PX


def _draw_scale(canvas: Canvas, view: View, width: int, middle: Px) -> None:
    metres = max(m for m in _SCALES_M if m * view.px_per_m <= 130 or m == 1)
    length = metres * view.px_per_m
    right, y = width - EDGE_PX, middle + 6.5
    for box in ((right - length, y - 1.5, right, y), (right - length, y - 6, right - length + 1.5, y)):
        canvas.box(*box, INK)
    canvas.box(right - 1.5, y - 6, right, y, INK)
    words = f"{metres} m"
    canvas.text((right - length / 2 - text_width(words, 12) / 2, y - 5), words, 12, INK)
