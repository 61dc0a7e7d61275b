"""Cases as pictures: a still PNG, an animated GIF, and two animations beside each other."""

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from regents_cosim.atomic import explain_write, write_atomic
from regents_cosim.report.camera import fit, fit_latest
from regents_cosim.report.canvas import Canvas
from regents_cosim.report.caption import FOOTER_PX, HEADER_PX, STRIP_PX, draw_footer, draw_header, draw_strip
from regents_cosim.report.film import Ground, Progress, frame_steps, gif_bytes, shoot
from regents_cosim.report.palette import ADVERSARY, HAIRLINE, INK, PANEL
from regents_cosim.report.scene import Scene, draw_ground, draw_moving
from regents_cosim.scenario import Scenario

STILL_SIZE = (1200, 800)  # [px]
GIF_SIZE = (900, 600)  # [px]

_STILL_ZOOM, _GIF_ZOOM = 3, 2
_STILL_PX_PER_M = 4.5  # a car is then 22 px long
_BESIDE, _BELOW = (500, 460), (1000, 300)  # size [px] of each of two pictures
_GAP_PX = 4


def draw_still(scenario: Scenario, path: Path) -> None:
    """Write a PNG of the collision, or of the end where there is none, with the ways that led there.

    Raises RegentsError where `path` cannot be written.
    """
    scene = Scene.of(scenario)
    width, height = STILL_SIZE
    points = scene.main_points()[: scene.shown_step + 1]
    view = fit_latest(points, (width, height - HEADER_PX - FOOTER_PX), _STILL_PX_PER_M)
    picture = draw_ground(scene, view, _STILL_ZOOM)
    draw_moving(scene, picture, view, scene.shown_step)
    canvas = Canvas.blank(STILL_SIZE, _STILL_ZOOM, PANEL)
    canvas.paste(picture, 0, HEADER_PX)
    canvas.paste(draw_header(scene, scene.shown_step, width, _STILL_ZOOM), 0, 0)
    canvas.paste(draw_footer(scene, view, width, _STILL_ZOOM), 0, height - FOOTER_PX)
    buffer = io.BytesIO()
    canvas.finish().save(buffer, "PNG")
    _write(path, buffer.getvalue())


def animate(scenario: Scenario, path: Path, progress: Progress | None = None) -> None:
    """Write a GIF in real time that stops about 1 s after the collision, or at the end.

    `progress` is told how many of how many frames are drawn. Raises RegentsError where `path`
    cannot be written.
    """
    scene = Scene.of(scenario)
    width, height = GIF_SIZE
    views = shoot(scene.main_points(), scenario.dt, (width, height - HEADER_PX - FOOTER_PX))
    ground = Ground(scene, views[0], _GIF_ZOOM)
    footer = draw_footer(scene, views[0], width, _GIF_ZOOM)

    def frame(step: int) -> Image.Image:
        picture = ground.under(views[step])
        draw_moving(scene, picture, views[step], step)
        canvas = Canvas.blank(GIF_SIZE, _GIF_ZOOM, PANEL)
        canvas.paste(draw_header(scene, step, width, _GIF_ZOOM), 0, 0)
        canvas.paste(picture, 0, HEADER_PX)
        canvas.paste(footer, 0, height - FOOTER_PX)
        return canvas.finish()

    _write_frames(path, frame, frame_steps(scene.last_step, scenario.dt), scenario.dt, progress)


def animate_pair(left: Scenario, right: Scenario, path: Path, progress: Progress | None = None) -> None:
    """Write one GIF of two Scenarios that share map, agents and time step: mostly before and after an attack.

    Both are seen by the same camera, beside each other, or below where the scene is wide. The
    adversary of the right one is coloured in both. Raises RegentsError as `animate` does.
    """
    after = Scene.of(right)
    before = Scene(left, after.adversary)
    last = min(before.last_step, after.last_step)
    points = np.concatenate([scene.main_points()[: last + 1] for scene in (before, after)], axis=1)
    size = _pair_size(points)
    views = shoot(points, right.dt, size)
    grounds = [(scene, Ground(scene, views[0], _GIF_ZOOM)) for scene in (before, after)]
    step_right, step_down = (size[0] + _GAP_PX, 0) if size == _BESIDE else (0, STRIP_PX + size[1])
    width, height = size[0] + step_right, HEADER_PX + STRIP_PX + size[1] + step_down + FOOTER_PX
    strips = [draw_strip(*_strip(scene), size[0], _GIF_ZOOM) for scene in (before, after)]
    footer = draw_footer(after, views[0], width, _GIF_ZOOM)

    def frame(step: int) -> Image.Image:
        canvas = Canvas.blank((width, height), _GIF_ZOOM, HAIRLINE)
        canvas.paste(draw_header(after, step, width, _GIF_ZOOM), 0, 0)
        for index, (scene, ground) in enumerate(grounds):
            picture = ground.under(views[step])
            draw_moving(scene, picture, views[step], step)
            x, y = index * step_right, HEADER_PX + index * step_down
            canvas.paste(strips[index], x, y)
            canvas.paste(picture, x, y + STRIP_PX)
        canvas.paste(footer, 0, height - FOOTER_PX)
        return canvas.finish()

    _write_frames(path, frame, frame_steps(last, right.dt), right.dt, progress)


def _pair_size(points: np.ndarray) -> tuple[int, int]:
    """The size of each of two pictures that shows the scene larger."""
    flat = points.reshape(-1, 2)
    present = flat[np.isfinite(flat).all(axis=1)]
    return max((_BESIDE, _BELOW), key=lambda size: fit(present, size).px_per_m)


def _strip(scene: Scene) -> tuple[str, tuple[int, int, int]]:
    attack = scene.scenario.attack
    if attack is None:
        return "before the attack", INK
    return f"after the attack ({attack.method})", ADVERSARY


def _write_frames(
    path: Path, frame: Callable[[int], Image.Image], steps: list[int], dt: float, progress: Progress | None
) -> None:
    def drawn():
        for done, step in enumerate(steps, 1):
            yield frame(step)
            if progress is not None:
                progress(done, len(steps))

    _write(path, gif_bytes(drawn(), dt))


def _write(path: Path, content: bytes) -> None:
    with explain_write(path.parent):
        write_atomic(path, content)
