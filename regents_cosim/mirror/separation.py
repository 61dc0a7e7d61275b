"""Distances between oriented boxes on the device, with gradients one can follow.

The same geometry as `regents_cosim.boxes`, the exact judge on the host. Hard minima are found
without gradient and only the winner is differentiated, so everything here is element-wise.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


class Box(eqx.Module):
    """Oriented rectangles; heading as (cos, sin), half sizes. Fields broadcast."""

    x: Float[Array, "*#axes"]  # [m]
    y: Float[Array, "*#axes"]  # [m]
    cos: Float[Array, "*#axes"]
    sin: Float[Array, "*#axes"]
    half_length: Float[Array, "*#axes"]  # [m]
    half_width: Float[Array, "*#axes"]  # [m]


def gap(a: Box, b: Box) -> Float[Array, "*axes"]:
    """Largest separation along the four axes of the two boxes [m]; negative where they overlap.

    A lower bound of their distance, equal to it unless corner faces corner; its negative is
    the least translation that separates overlapping boxes.
    Source: separating-axis theorem for rectangles.
    """
    dx, dy = b.x - a.x, b.y - a.y
    cos, sin = jnp.abs(a.cos * b.cos + a.sin * b.sin), jnp.abs(a.cos * b.sin - a.sin * b.cos)
    along_a = jnp.abs(dx * a.cos + dy * a.sin) - (a.half_length + b.half_length * cos + b.half_width * sin)
    across_a = jnp.abs(dy * a.cos - dx * a.sin) - (a.half_width + b.half_length * sin + b.half_width * cos)
    along_b = jnp.abs(dx * b.cos + dy * b.sin) - (b.half_length + a.half_length * cos + a.half_width * sin)
    across_b = jnp.abs(dy * b.cos - dx * b.sin) - (b.half_width + a.half_length * sin + a.half_width * cos)
    return jnp.maximum(jnp.maximum(along_a, across_a), jnp.maximum(along_b, across_b))


def overlaps(a: Box, b: Box, depth_m: float = 0.0) -> Bool[Array, "*axes"]:
    """Whether two boxes overlap by at least `depth_m`; touching counts at depth 0. ReGentS eq. 2."""
    return gap(a, b) <= -depth_m


def distance(a: Box, b: Box) -> Float[Array, "*axes"]:
    """Distance of the closest points of two boxes [m], 0 where they overlap. ReGentS eq. 1.

    The least of the eight corner-to-box distances. The gradient is that of the closest corner
    (the mean of two on a tie) and 0 where the boxes overlap; it is finite everywhere.
    """
    squares = jnp.minimum(_least_corner_square(a, b), _least_corner_square(b, a))
    apart = (gap(a, b) > 0.0) & (squares > 0.0)
    return jnp.where(apart, jnp.sqrt(jnp.where(apart, squares, 1.0)), 0.0)


def corners(box: Box) -> tuple[Float[Array, "4 *axes"], Float[Array, "4 *axes"]]:
    """X and y [m] of the corners: front left, front right, rear right, rear left."""
    along, across = jnp.array([1.0, 1.0, -1.0, -1.0]), jnp.array([1.0, -1.0, -1.0, 1.0])
    shape = jnp.broadcast_shapes(*(value.shape for value in jax.tree.leaves(box)))
    along, across = (
        sign.astype(box.x.dtype).reshape(4, *(1,) * len(shape)) * half
        for sign, half in ((along, box.half_length), (across, box.half_width))
    )
    return box.x + along * box.cos - across * box.sin, box.y + along * box.sin + across * box.cos


def _least_corner_square(box: Box, other: Box) -> Float[Array, "*axes"]:
    """Squared distance from the closest corner of `other` to the filled rectangle `box` [m^2].

    Written out corner by corner: one fused loop, 3.5 us for 32 x 81 boxes where a stacked minimum took 8 to 10.
    """
    dx, dy = other.x - box.x, other.y - box.y
    ahead, left = dx * box.cos + dy * box.sin, dy * box.cos - dx * box.sin
    cos, sin = box.cos * other.cos + box.sin * other.sin, box.cos * other.sin - box.sin * other.cos
    squares = []
    for along, across in ((1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)):
        x = ahead + along * other.half_length * cos - across * other.half_width * sin
        y = left + along * other.half_length * sin + across * other.half_width * cos
        out_long = jnp.maximum(jnp.abs(x) - box.half_length, 0.0)
        out_wide = jnp.maximum(jnp.abs(y) - box.half_width, 0.0)
        squares.append(out_long**2 + out_wide**2)
    return jnp.minimum(jnp.minimum(squares[0], squares[1]), jnp.minimum(squares[2], squares[3]))
