"""Exact oriented boxes on the host, by which every collision is judged.

All functions broadcast; positions are in metres, yaw in radians counter-clockwise from +x. Boxes are closed: touching
counts as overlapping, so `overlap` holds exactly where `distance` is 0.

Only boxes on one level (`same_level`) can meet: a box on a bridge is infinitely far from one under it.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

Values = Float[np.ndarray, "..."] | float

# The roads under two vehicles that can touch differ by less in height: on one road, with centres 10 m apart, by 3 m on
# a slope of 30 %. Bridges are higher: most countries require a headroom of at least 4 m under the deck.
CLEARANCE_M = 3.0


class Boxes(NamedTuple):
    """Oriented rectangles, given by their centres; the fields broadcast against each other."""

    x: Values  # [m]
    y: Values  # [m]
    yaw: Values  # [rad]
    length: Values  # [m]
    width: Values  # [m]
    z: Values = 0.0  # [m] height of the road under the box


_ALONG = np.array([0.5, 0.5, -0.5, -0.5])
_ACROSS = np.array([0.5, -0.5, -0.5, 0.5])


def corners(boxes: Boxes) -> Float[np.ndarray, "... 4 2"]:
    """Corner positions [m]: front left, front right, rear right, rear left."""
    x, y, yaw, length, width = (np.asarray(v, float)[..., None] for v in boxes[:5])
    along, across = length * _ALONG, width * _ACROSS
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.stack(np.broadcast_arrays(x + along * cos - across * sin, y + along * sin + across * cos), axis=-1)


def in_between(boxes: Boxes, parts: int) -> Boxes:
    """Boxes [... time] with `parts` - 1 further instants between two steps, moved and turned evenly.

    The last axis has `parts` x (time - 1) + 1 entries; every `parts`-th is a step.
    """
    fields = np.broadcast_arrays(boxes.x, boxes.y, np.unwrap(boxes.yaw), boxes.length, boxes.width, boxes.z)
    share = np.arange(parts) / parts

    def between(values: Float[np.ndarray, "... time"]) -> Float[np.ndarray, "... instant"]:
        ways = values[..., :-1, None] + np.diff(values)[..., None] * share
        return np.concatenate([ways.reshape(*values.shape[:-1], -1), values[..., -1:]], axis=-1)

    return Boxes(*map(between, fields))


def there_between(valid: Bool[np.ndarray, "... time"], parts: int) -> Bool[np.ndarray, "... instant"]:
    """`valid` at the instants of `in_between`: between two steps it holds if it holds at both."""
    both = valid[..., :-1] & valid[..., 1:]
    ways = np.concatenate([valid[..., :-1, None], np.repeat(both[..., None], parts - 1, axis=-1)], axis=-1)
    return np.concatenate([ways.reshape(*valid.shape[:-1], -1), valid[..., -1:]], axis=-1)


def same_level(a: Values, b: Values) -> Bool[np.ndarray, "..."] | np.bool_:
    """Whether vehicles on roads of heights `a` and `b` [m] can meet."""
    return np.abs(np.subtract(a, b)) < CLEARANCE_M


def overlap(a: Boxes, b: Boxes) -> Bool[np.ndarray, "..."] | np.bool_:
    """Whether two boxes of one level share a point, by the four separating axes of two rectangles.

    Source: separating-axis theorem (Gottschalk et al. 1996). Two boxes can cross like a plus sign with no corner of
    either inside the other, so testing corners is not enough.
    """
    turn = np.subtract(b.yaw, a.yaw)
    cos, sin = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    a_long, a_wide = np.multiply(0.5, a.length), np.multiply(0.5, a.width)
    b_long, b_wide = np.multiply(0.5, b.length), np.multiply(0.5, b.width)
    ahead_a, left_a = _in_frame(a, b)
    ahead_b, left_b = _in_frame(b, a)
    return (
        (np.abs(ahead_a) <= a_long + b_long * cos + b_wide * sin)
        & (np.abs(left_a) <= a_wide + b_long * sin + b_wide * cos)
        & (np.abs(ahead_b) <= b_long + a_long * cos + a_wide * sin)
        & (np.abs(left_b) <= b_wide + a_long * sin + a_wide * cos)
        & same_level(a.z, b.z)
    )


def distance(a: Boxes, b: Boxes) -> Values:
    """Distance between the closest points of two boxes [m]; 0 where they overlap, infinite between levels.

    The closest pair of points of disjoint rectangles always holds a corner of one of them, so the least of the eight
    corner-to-box distances is exact. Source: ReGentS eq. 1.
    """
    apart = np.minimum(_least_corner_distance(a, b), _least_corner_distance(b, a))
    return np.where(overlap(a, b), 0.0, np.where(same_level(a.z, b.z), apart, np.inf))


def _in_frame(a: Boxes, b: Boxes) -> tuple[Values, Values]:
    """Centre of `b` as (ahead, left) in the frame of `a` [m]."""
    dx, dy = np.subtract(b.x, a.x), np.subtract(b.y, a.y)
    cos, sin = np.cos(a.yaw), np.sin(a.yaw)
    return dx * cos + dy * sin, dy * cos - dx * sin


def _least_corner_distance(box: Boxes, other: Boxes) -> Values:
    """Least distance from a corner of `other` to the filled rectangle `box` [m]."""
    points = corners(other)
    x, y, yaw, length, width = (np.asarray(v, float)[..., None] for v in box[:5])
    dx, dy = points[..., 0] - x, points[..., 1] - y
    cos, sin = np.cos(yaw), np.sin(yaw)
    out_long = np.maximum(np.abs(dx * cos + dy * sin) - 0.5 * length, 0.0)
    out_wide = np.maximum(np.abs(dy * cos - dx * sin) - 0.5 * width, 0.0)
    return np.hypot(out_long, out_wide).min(axis=-1)
