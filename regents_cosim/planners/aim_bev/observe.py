"""The view of a camera straight above the ego: 192 x 192 pixels, 5 per metre by default, the ego's yaw up.

The ego is in the middle and is not drawn. From bottom to top: road surface, lane lines, road edge, stop bars in the
colour of their light, other road users as boxes, and on each a heading mark, a bar from its centre ahead that ends half
a second's way beyond its front; it shows direction and speed.

Boxes are filled row by row: on one row of pixels a box is an interval of columns, and 192 columns are the bits of six
words, so any number of boxes costs a few thousand operations each. Source: the observer of KING (Hanselmann et al.
2022) and ReGentS section 3.
"""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt8, UInt32

from regents_cosim.geometry.frames import along_and_left
from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.separation import Box
from regents_cosim.planners.aim_bev.camera import PAPERS, PIXELS, Camera
from regents_cosim.planners.aim_bev.ground import DARK, Ground

MARK_S = 0.5  # a heading mark reaches this time of travel beyond the front
MARK_WIDTH_M = 0.6
MOST = 24  # the most other agents, and stop bars, that are drawn: the nearest ones

# The colours of what a pixel can show, later ones on top; red, green and blue in steps of 36.
_LEVEL = 36
COLOURS = _LEVEL * np.array(
    [
        (0, 0, 0),  # land
        (2, 2, 2),  # road surface
        (4, 4, 4),  # lane line
        (6, 6, 6),  # road edge
        (7, 0, 0),  # red light
        (0, 7, 0),  # green
        (7, 7, 0),  # amber
        (0, 0, 7),  # another road user
        (7, 0, 7),  # its heading mark
    ],
    np.uint8,
)
# The colours per channel in one word, three bits each.
_TABLE = ((COLOURS // _LEVEL).astype(np.uint32) << (3 * np.arange(len(COLOURS), dtype=np.uint32))[:, None]).sum(
    axis=0, dtype=np.uint32
)
_WORDS = PIXELS // 32


class Surroundings(eqx.Module):
    """Everything that moves or changes, at one instant or over time."""

    boxes: Box  # [agent] other road users
    speed: Float[Array, "*axes agent"]  # [m/s]
    valid: Bool[Array, "*axes agent"]
    lights: UInt8[Array, "*axes bar"]  # RED, AMBER, GREEN or DARK


def observe(
    ground: Ground, bars: Box, view: Surroundings, ego: Motion, camera: Camera = PAPERS
) -> UInt8[Array, "192 192 3"]:
    """The view from above the ego at one instant; everything is in the coordinates of `ego`.

    `ground` must be drawn for the same `camera`.
    """
    cos, sin = jnp.cos(ego.yaw), jnp.sin(ego.yaw)
    bars, light = _nearest(_from_ego(bars, ego, cos, sin), view.lights != DARK, view.lights)
    others, speed, valid = _nearest(_from_ego(view.boxes, ego, cos, sin), view.valid, view.speed, view.valid)
    first, second = (_rows_filled(bars, (light & bit) > 0, camera) for bit in (np.uint8(1), np.uint8(2)))
    moving = (_rows_filled(boxes, valid, camera) for boxes in (others, _marks(others, speed)))
    planes = _in_order(first, second, *moving)
    bits = ((plane[..., None] >> np.arange(32, dtype=np.uint32)) & np.uint32(1) for plane in planes)
    moving = functools.reduce(jnp.bitwise_or, (bit << power for power, bit in enumerate(bits)))
    moving = moving.reshape(PIXELS, PIXELS)
    shown = jnp.where(moving > 0, moving, _ground_under(ground, ego, cos, sin, camera).astype(jnp.uint32))
    return (((_TABLE >> (3 * shown[..., None])) & np.uint32(7)) * np.uint32(_LEVEL)).astype(jnp.uint8)


def _nearest(boxes: Box, there: Bool[Array, " box"], *values: Array) -> tuple[Any, ...]:
    """The boxes nearest to the ego, given in its frame, with the values that belong to them.

    Absent boxes come last: arrays are filled up with boxes at the origin, and the last place of a vehicle that has left
    may be near.
    """
    if boxes.x.shape[0] <= MOST:
        return boxes, *values
    _, kept = jax.lax.top_k(-jnp.where(there, boxes.x**2 + boxes.y**2, jnp.inf), MOST)
    return jax.tree.map(lambda value: value[kept], (boxes, *values))


def _in_order(first: Array, second: Array, other: Array, mark: Array) -> tuple[UInt32[Array, "row word"], ...]:
    """The topmost item of each pixel as bit planes: 4 red, 5 green, 6 amber, 7 road user, 8 heading mark, 0 none."""
    other = other & ~mark
    lit = (first | second) & ~(other | mark)
    return (second & ~first & lit) | other, (second & first & lit) | other, lit | other, mark


def _ground_under(ground: Ground, ego: Motion, cos: Array, sin: Array, camera: Camera) -> UInt8[Array, "192 192"]:
    """The cell of the ground nearest to the centre of every pixel."""
    scale, offsets = np.float32(1.0 / camera.cell_m), camera.offsets_m
    ahead, left = offsets[:, None] * scale, offsets[None, :] * scale
    column = (ego.x - ground.corner[0]) * scale + ahead * cos - left * sin
    row = (ego.y - ground.corner[1]) * scale + ahead * sin + left * cos
    rows, columns = ground.shape[0], ground.shape[1]
    column = jnp.clip(jnp.round(column).astype(jnp.int32), 0, columns - 1)
    row = jnp.clip(jnp.round(row).astype(jnp.int32), 0, rows - 1)
    return ground.cells.at[ground.first + row * columns + column].get(mode="promise_in_bounds")


def _from_ego(box: Box, ego: Motion, cos: Array, sin: Array) -> Box:
    """Boxes in the ego's frame: x ahead of it, y to its left."""
    place = along_and_left(box.x - ego.x, box.y - ego.y, cos, sin)
    return Box(*place, *along_and_left(box.cos, box.sin, cos, sin), box.half_length, box.half_width)


def _marks(box: Box, speed: Float[Array, " agent"]) -> Box:
    half = 0.5 * (box.half_length + MARK_S * speed)
    half_width = jnp.full_like(half, 0.5 * MARK_WIDTH_M)
    return Box(box.x + half * box.cos, box.y + half * box.sin, box.cos, box.sin, half, half_width)


def _rows_filled(box: Box, drawn: Bool[Array, " box"], camera: Camera) -> UInt32[Array, "row word"]:
    """One bit per pixel: whether its centre lies in a box that is `drawn`."""
    box = jax.tree.map(lambda values: values[:, None], box)
    offsets = camera.offsets_m
    further = offsets - box.x
    along, across = _away_from_zero(box.sin), _away_from_zero(box.cos)
    middle, half = -box.cos * further / along, box.half_length / jnp.abs(along)
    least, most = middle - half, middle + half
    middle, half = box.sin * further / across, box.half_width / jnp.abs(across)
    least, most = jnp.maximum(least, middle - half), jnp.minimum(most, middle + half)
    pixel = np.float32(1.0 / camera.pixel_m)
    begin = jnp.ceil((offsets[0] - box.y - most) * pixel)
    end = jnp.floor((offsets[0] - box.y - least) * pixel) + 1.0
    begin, end = (jnp.clip(edge, 0.0, PIXELS).astype(jnp.int32) for edge in (begin, end))
    end = jnp.where(drawn[:, None], end, 0)
    words = _bits_below(end) & ~_bits_below(begin)
    return jax.lax.reduce(words, np.uint32(0), jax.lax.bitwise_or, (0,))


def _bits_below(column: Int[Array, "box row"]) -> UInt32[Array, "box row word"]:
    """Six words whose bits are set for all columns below `column`."""
    count = column[..., None] - 32 * np.arange(_WORDS, dtype=np.int32)
    some = (np.uint32(1) << jnp.clip(count, 0, 31).astype(jnp.uint32)) - np.uint32(1)
    return jnp.where(count >= 32, np.uint32(0xFFFFFFFF), some)


def _away_from_zero(value: Float[Array, "box 1"]) -> Float[Array, "box 1"]:
    return jnp.where(jnp.abs(value) < 1e-6, np.float32(1e-6), value)
