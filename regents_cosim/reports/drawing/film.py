"""Animations: the camera's movement, the background, and the file of all frames."""

import functools
import io
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float
from PIL import Image

from regents_cosim.reports.drawing.camera import View, fit, follow, trim
from regents_cosim.reports.drawing.canvas import Canvas
from regents_cosim.reports.drawing.palette import LAND, gif_palette
from regents_cosim.reports.drawing.pictured_case import PicturedCase, draw_ground
from regents_cosim.system.files.output_files import MARK

_FRAME_S = 0.1
_HOLD_MS = 1500  # duration of the last frame
_LEAST_PX_PER_M = 5.0  # below this scale the camera follows the scene instead of showing it as a whole
_FOLLOW_PX_PER_M = 6.5


def shoot(
    points: Float[np.ndarray, "time agent 2"], dt: float, size: tuple[int, int], least_height: int
) -> Sequence[View]:
    """One view per instant: a fixed one if it shows everything large enough, otherwise one that follows.

    `points` [m] may be NaN where an agent is absent. Views have `size` [px], or less height for a flat scene.
    """
    flat = points.reshape(-1, 2)
    present = flat[np.isfinite(flat).all(axis=1)]
    whole = fit(present, trim(present, size, least_height))
    if whole.px_per_m >= _LEAST_PX_PER_M:
        return [whole] * len(points)
    return follow(np.nanmean(points, axis=1), dt, _FOLLOW_PX_PER_M, size)


class Backdrop:
    """The static background, drawn once per tile of a view's size, so that a long path needs little memory."""

    def __init__(self, scene: PicturedCase, origin: View, zoom: int) -> None:
        self._scene, self._origin, self._zoom = scene, origin, zoom
        self._tile = functools.lru_cache(maxsize=6)(self._draw)  # a view touches at most four

    def under(self, view: View) -> Canvas:
        """A new canvas with the background of `view`, which is the first view moved by whole pixels."""
        right = round((view.left - self._origin.left) * view.px_per_m)
        down = round((self._origin.top - view.top) * view.px_per_m)
        canvas = Canvas.blank((view.width, view.height), self._zoom, LAND)
        for row in range(down // view.height, -(-(down + view.height) // view.height)):
            for column in range(right // view.width, -(-(right + view.width) // view.width)):
                canvas.paste(self._tile(column, row), column * view.width - right, row * view.height - down)
        return canvas

    def _draw(self, column: int, row: int) -> Canvas:
        origin = self._origin
        return draw_ground(self._scene, origin.shifted(column * origin.width, row * origin.height), self._zoom)


def frame_steps(last: int, dt: float) -> list[int]:
    """The steps that become frames: about ten per second, and always the last one."""
    steps = list(range(0, last + 1, _stride(dt)))
    return steps if steps[-1] == last else [*steps, last]


def gif_bytes(frames: Iterator[Image.Image], dt: float) -> bytes:
    """An endless GIF in real time that holds its last frame."""
    palette = gif_palette()
    indexed = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    # GIF counts in hundredths of a second
    durations = [10 * round(100 * dt * _stride(dt))] * (len(indexed) - 1) + [_HOLD_MS]
    buffer = io.BytesIO()
    indexed[0].save(
        buffer, "GIF", comment=MARK, save_all=True, append_images=indexed[1:], duration=durations, loop=0,
        optimize=True, palette=palette.palette,
    )  # fmt: skip
    return buffer.getvalue()


def _stride(dt: float) -> int:
    return max(round(_FRAME_S / dt), 1)
