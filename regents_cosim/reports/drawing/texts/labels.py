"""Places short texts beside what they name, apart from each other and from what must stay visible."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from regents_cosim.reports.drawing.canvas import Canvas, Px, text_width
from regents_cosim.reports.drawing.palette import PANEL, Colour

LABEL_PX = 12
_MARGIN_PX = 4.0  # to the edge of the picture, and between texts
_GAPS_PX = (9.0, 14.0, 20.0, 28.0, 38.0, 50.0, 66.0, 86.0, 110.0)  # between a text and what it names
_ANGLES = np.deg2rad(np.arange(16) * 22.5)
_LEADER_PX = 16.0  # from this gap on a line leads from the text to its place
_COVERED_COST = 6.0  # [px] of more gap that are rather taken than that a point of a path is covered
_MOST_COVERED = 2  # points that a text may cover that is left out without room near its place
_CROSSED_COST = 25.0  # [px] the same for a line to a place that crosses another text

Box = tuple[Px, Px, Px, Px]  # left, top, right, bottom [px]


@dataclass(frozen=True)
class Label:
    """A text that names a place."""

    at: tuple[Px, Px]  # [px]
    words: str
    colour: Colour
    reach: float = np.inf  # [px] greatest gap between the text and its place: without room so near there is none


@dataclass(frozen=True)
class PlacedLabel:
    """A label and the box that its text fills."""

    label: Label
    box: Box


def draw_labels(canvas: Canvas, labels: Sequence[PlacedLabel], right: Px = 0, down: Px = 0) -> None:
    """Draw the texts, moved by some pixels, over lines to the places of those that are far from theirs."""
    for placed in labels:
        line = _leader(placed.label, np.array([placed.box])) + np.array([right, down])
        if np.hypot(*(line[1] - line[0])[0]) >= _LEADER_PX:
            canvas.line(line[:, 0], placed.label.colour, 1.0)
    for placed in labels:
        left, top, _, bottom = placed.box
        at = left + right, top + down + 0.78 * (bottom - top)
        canvas.text(at, placed.label.words, LABEL_PX, placed.label.colour, halo=PANEL)


def place(
    labels: Sequence[Label],
    size: tuple[int, int] | None,
    kept_free: Sequence[Box],
    points: Float[np.ndarray, "point 2"],
) -> list[PlacedLabel]:
    """Place the labels that find room, the first ones first: off all boxes, rather off `points`, and inside `size`."""
    found, taken = list[PlacedLabel](), list(kept_free)
    for label in labels:
        box = _best(label, size, taken, points)
        if box is not None:
            found.append(PlacedLabel(label, box))
            taken.append(box)
    return found


def _best(
    label: Label, size: tuple[int, int] | None, taken: list[Box], points: Float[np.ndarray, "point 2"]
) -> Box | None:
    boxes, gaps = _candidates(label)
    others = np.array(taken, float).reshape(-1, 4)
    covered = _meet(boxes, np.concatenate([points, points], axis=1)).sum(axis=1)
    free = (gaps <= label.reach) & ~_meet(boxes, others).any(axis=1)
    if size is not None:
        free &= (boxes >= _MARGIN_PX).all(axis=1) & (boxes[:, 2:] <= np.array(size) - _MARGIN_PX).all(axis=1)
    if np.isfinite(label.reach):
        free &= covered <= _MOST_COVERED
    if not free.any():
        return None
    cost = gaps + _COVERED_COST * covered + _CROSSED_COST * _crossed(_leader(label, boxes), others)
    left, top, right, bottom = boxes[np.argmin(np.where(free, cost, np.inf))].tolist()
    return left, top, right, bottom


def _leader(label: Label, boxes: Float[np.ndarray, "box 4"]) -> Float[np.ndarray, "2 box 2"]:
    """The lines from a place to the nearest points of boxes."""
    at = np.broadcast_to(np.array(label.at), (len(boxes), 2))
    return np.stack([at, np.clip(at, boxes[:, :2], boxes[:, 2:])])


def _crossed(lines: Float[np.ndarray, "2 box 2"], others: Float[np.ndarray, "other 4"]) -> Int[np.ndarray, " box"]:
    """The number of other boxes that each line crosses on its outer half: it may begin in one."""
    points = np.linspace(0.5 * (lines[0] + lines[1]), lines[1], 8)[:, :, None]
    inside = ((points > others[:, :2]) & (points < others[:, 2:])).all(axis=-1)
    return inside.any(axis=0).sum(axis=-1)


def _candidates(label: Label) -> tuple[Float[np.ndarray, "box 4"], Float[np.ndarray, " box"]]:
    half = 0.5 * np.array([text_width(label.words, LABEL_PX), 1.15 * LABEL_PX])
    ways = np.stack([np.sin(_ANGLES), -np.cos(_ANGLES)], axis=-1)  # the one above comes first
    gaps = np.repeat(_GAPS_PX, len(ways))
    ways = np.tile(ways, (len(_GAPS_PX), 1))
    middle = np.array(label.at) + ways * (gaps[:, None] + half)
    return np.concatenate([middle - half, middle + half], axis=1), gaps


def _meet(boxes: Float[np.ndarray, "box 4"], others: Float[np.ndarray, "other 4"]) -> Bool[np.ndarray, "box other"]:
    low, high = boxes[:, None, :2] - _MARGIN_PX, boxes[:, None, 2:] + _MARGIN_PX
    near: Bool[np.ndarray, "box other 2"] = (low < others[None, :, 2:]) & (high > others[None, :, :2])
    return near[..., 0] & near[..., 1]
