"""Antialiased drawing with Pillow: everything is drawn larger, and reduced at the end."""

import functools
import io
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float
from PIL import Image, ImageDraw, ImageFont
from PIL.PngImagePlugin import PngInfo

from regents_cosim.geometry.lines import distances_along, points_at
from regents_cosim.reports.drawing.palette import Colour
from regents_cosim.system.files.output_files import MARK

Points = Float[np.ndarray, "point 2"]
Px = int | float  # final pixels
Anchor = Literal["ls", "rs", "ms"]  # left, right, middle of the baseline


@dataclass(frozen=True)
class Canvas:
    """An image drawn at `zoom` times its size. All lengths are in final pixels."""

    image: Image.Image
    zoom: int

    @classmethod
    def blank(cls, size: tuple[int, int], zoom: int, colour: Colour) -> "Canvas":
        """A canvas of one colour."""
        return cls(Image.new("RGB", (size[0] * zoom, size[1] * zoom), colour), zoom)

    @functools.cached_property
    def _draw(self) -> ImageDraw.ImageDraw:
        return ImageDraw.Draw(self.image)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in final pixels."""
        return self.image.width // self.zoom, self.image.height // self.zoom

    def finish(self) -> Image.Image:
        """The image in its final size."""
        return self.image.reduce(self.zoom) if self.zoom > 1 else self.image

    def paste(self, other: "Canvas", left: int, top: int) -> None:
        """Paste another canvas of the same zoom onto this one."""
        self.image.paste(other.image, (left * self.zoom, top * self.zoom))

    def polygon(self, points: Points, fill: Colour) -> None:
        """Draw a filled polygon."""
        self._draw.polygon(self._scaled(points), fill=fill)

    def line(self, points: Points, colour: Colour, width: Px) -> None:
        """Draw a line through all points, with round corners."""
        if len(points) >= 2:
            self._draw.line(self._scaled(points), fill=colour, width=self._thick(width), joint="curve")

    def outline(self, points: Points, colour: Colour, width: Px) -> None:
        """Draw the closed line around a polygon."""
        self.line(np.concatenate([points, points[:2]]), colour, width)

    def dashed(self, points: Points, colour: Colour, width: Px, pattern: tuple[Px, Px]) -> None:
        """Draw a dashed line; `pattern` is the length of a dash and of a gap."""
        period, edge = sum(pattern), np.add(self.size, width)
        for start, end in stretches_inside(points, np.full(2, -float(width)), edge):
            first = period * (start // period)  # a dash that is partly visible begins before
            for dash in dashes(points, *pattern, (first, end)):
                self.line(dash, colour, width)

    def disc(self, centre: Float[np.ndarray, " 2"], radius: Px, fill: Colour) -> None:
        """Draw a filled circle."""
        self._draw.ellipse(self._around(centre, radius), fill=fill)

    def ring(self, centre: Float[np.ndarray, " 2"], radius: Px, colour: Colour, width: Px) -> None:
        """Draw a circle whose line lies inside `radius`."""
        self._draw.ellipse(self._around(centre, radius), outline=colour, width=self._thick(width))

    def box(self, left: Px, top: Px, right: Px, bottom: Px, fill: Colour) -> None:
        """Draw an upright rectangle, unless it is empty."""
        x0, y0, x1, y1 = (round(edge * self.zoom) for edge in (left, top, right, bottom))
        if x1 > x0 and y1 > y0:
            self._draw.rectangle((x0, y0, x1 - 1, y1 - 1), fill=fill)

    def text(
        self,
        at: tuple[Px, Px],
        words: str,
        size: int,
        colour: Colour,
        anchor: Anchor = "ls",
        bold: bool = False,
        halo: Colour | None = None,
    ) -> float:
        """Write `words` in one line, with a `halo` that sets them off from a picture, and return their width."""
        (place,) = self._scaled([at])
        if halo is not None:
            around = {"stroke_width": self._thick(2.5), "stroke_fill": halo}
            self._draw.text(place, words, fill=halo, font=_font(size * self.zoom), anchor=anchor, **around)
        if not bold:
            self._draw.text(place, words, fill=colour, font=_font(size * self.zoom), anchor=anchor)
            return text_width(words, size)
        return self._bold(place, words, size, colour, anchor)

    def _bold(self, place: tuple[float, float], words: str, size: int, colour: Colour, anchor: Anchor) -> float:
        """Write bold text by thickening and spacing the letters, since Pillow's font has only one weight."""
        font, stroke = _font(size * self.zoom), max(round(0.02 * size * self.zoom), 1)
        room = [font.getlength(letter) + stroke for letter in words]
        x = place[0] - {"ls": 0.0, "ms": 0.5, "rs": 1.0}[anchor] * sum(room)
        for letter, width in zip(words, room, strict=True):
            self._draw.text((x, place[1]), letter, fill=colour, font=font, anchor="ls", stroke_width=stroke)
            x += width
        return sum(room) / self.zoom

    def _scaled(self, points: Points | list[tuple[Px, Px]]) -> list[tuple[float, float]]:
        return [(x, y) for x, y in (np.asarray(points, float) * self.zoom).tolist()]

    def _around(self, centre: Float[np.ndarray, " 2"], radius: Px) -> list[tuple[float, float]]:
        return self._scaled(np.array([centre - radius, centre + radius]))

    def _thick(self, width: Px) -> int:
        return max(1, round(width * self.zoom))


def dashes(
    points: Points, dash: Px, gap: Px, part: tuple[float, float] | None = None
) -> list[Float[np.ndarray, "_ 2"]]:
    """Cut a line into dashes, starting with one; `part` selects those that begin between two distances."""
    along = distances_along(*points.T)
    first, last = part or (0.0, along[-1])
    found = []
    for start in np.arange(first, min(last, along[-1]), dash + gap):
        end = min(start + dash, along[-1])
        at = np.concatenate([[start], along[(along > start) & (along < end)], [end]])
        found.append(points_at(at, along, points))
    return found


def stretches_inside(
    points: Points, low: Float[np.ndarray, " 2"], high: Float[np.ndarray, " 2"]
) -> list[tuple[float, float]]:
    """The stretches (begin, end) along a line that lie in the box from `low` to `high`, in order."""
    along, start, way = distances_along(*points.T), points[:-1], np.diff(points, axis=0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        sides = np.stack([(low - start) / way, (high - start) / way])
    beside = (way == 0.0) & ((start < low) | (start > high))  # runs outside, parallel to the box
    sides = np.where(way == 0.0, np.array([-np.inf, np.inf])[:, None, None], sides)
    enter = np.clip(sides.min(axis=0).max(axis=-1), 0.0, 1.0)
    leave = np.clip(sides.max(axis=0).min(axis=-1), 0.0, 1.0)
    length, found = np.diff(along), []
    for k in np.flatnonzero((enter < leave) & ~beside.any(axis=-1)).tolist():
        begin, end = float(along[k] + enter[k] * length[k]), float(along[k] + leave[k] * length[k])
        if found and begin - found[-1][1] <= 1e-9 * along[-1]:
            found[-1] = found[-1][0], end
        else:
            found.append((begin, end))
    return found


def png_bytes(image: Image.Image, optimize: bool = False) -> bytes:
    """The picture as a PNG with the mark of this package."""
    mark, buffer = PngInfo(), io.BytesIO()
    mark.add_text("Software", MARK)
    image.save(buffer, "PNG", pnginfo=mark, optimize=optimize)
    return buffer.getvalue()


def text_width(words: str, size: int) -> float:
    """Width of one line of text [px]."""
    return _font(size).getlength(words)


def shorten(words: str, size: int, width: Px) -> str:
    """The `words`, cut in the middle if they are wider than `width` [px]."""
    if text_width(words, size) <= width:
        return words
    for kept in range(len(words) - 1, 1, -1):
        head = (kept + 1) // 2
        short = words[:head] + "..." + words[len(words) - (kept - head) :]
        if text_width(short, size) <= width:
            return short
    return words[:1]


@functools.lru_cache(maxsize=32)
def _font(size: int) -> ImageFont.ImageFont | ImageFont.FreeTypeFont:
    return ImageFont.load_default(size)
