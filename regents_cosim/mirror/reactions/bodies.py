"""The bodies of agents as others see them, and where those lie along the arc on which an agent drives."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.geometry.boxes import same_level
from regents_cosim.geometry.frames import along_and_left
from regents_cosim.mirror.bicycle import Motion

_STRAIGHT = 1e-4  # [1/m] smaller curvatures count as straight


class Bodies(eqx.Module):
    """The bodies of agents at one instant."""

    x: Float[Array, " agent"]  # [m]
    y: Float[Array, " agent"]  # [m]
    cos: Float[Array, " agent"]  # of the yaw
    sin: Float[Array, " agent"]
    speed: Float[Array, " agent"]  # [m/s]
    half_length: Float[Array, " agent"]  # [m]
    half_width: Float[Array, " agent"]  # [m]
    index: Int[Array, " agent"]
    z: Float[Array, " agent"] | None  # [m] height of the road, in scenes with roads above each other


class Along(eqx.Module):
    """Where others are, seen from an agent on its arc; distances are exact for a circle."""

    ahead: Float[Array, "agent other"]  # [m] along the arc to the middle of the other
    left: Float[Array, "agent other"]  # [m] of the arc
    reach: Float[Array, "agent other"]  # [m] half the length that the other takes along the arc
    breadth: Float[Array, "agent other"]  # [m] half the width that it takes across
    same: Float[Array, "agent other"]  # cosine of the angle between both directions
    apart: Bool[Array, "agent other"]  # whether they are the same agent, or on different levels


def bodies(
    now: Motion,
    half_length: Float[Array, " agent"],
    half_width: Float[Array, " agent"],
    z: Float[Array, " agent"] | None,
) -> Bodies:
    """The bodies of agents that are at `now` [agent]."""
    index = jnp.arange(len(now.x))
    return Bodies(now.x, now.y, jnp.cos(now.yaw), jnp.sin(now.yaw), now.speed, half_length, half_width, index, z)


def along_arcs(mine: Bodies, bend: Float[Array, " agent"], theirs: Bodies) -> Along:
    """Where `theirs` are along the arcs of curvature `bend` [1/m] on which `mine` drive."""
    dx, dy = theirs.x[None] - mine.x[:, None], theirs.y[None] - mine.y[:, None]
    cos, sin = mine.cos[:, None], mine.sin[:, None]
    far, aside = along_and_left(dx, dy, cos, sin)
    k = jnp.where(jnp.abs(bend) < _STRAIGHT, _STRAIGHT, bend)[:, None]
    # The direction of the arc beside the other agent, as a vector: only the arc length needs an angle.
    from_centre = jnp.sqrt((k * far) ** 2 + (1.0 - k * aside) ** 2)
    arc_cos, arc_sin = (1.0 - k * aside) / from_centre, k * far / from_centre
    turned_cos, turned_sin = cos * arc_cos - sin * arc_sin, sin * arc_cos + cos * arc_sin
    same, across = along_and_left(theirs.cos[None], theirs.sin[None], turned_cos, turned_sin)
    reach, breadth = extents(jnp.abs(same), jnp.abs(across), theirs.half_length[None], theirs.half_width[None])
    apart = mine.index[:, None] == theirs.index[None]
    if mine.z is not None and theirs.z is not None:
        apart |= ~same_level(mine.z[:, None], theirs.z[None])
    return Along(_angle(arc_cos, arc_sin) / k, (1.0 - from_centre) / k, reach, breadth, same, apart)


def extents(
    same: Float[Array, "*axes"],
    across: Float[Array, "*axes"],
    half_length: Float[Array, "*#axes"],
    half_width: Float[Array, "*#axes"],
) -> tuple[Float[Array, "*axes"], Float[Array, "*axes"]]:
    """Half the length [m] that a body takes along a direction, and half the width across.

    `same` and `across` are the magnitudes of cosine and sine of the angle between the body and the direction.
    """
    return same * half_length + across * half_width, across * half_length + same * half_width


def _angle(cos: Float[Array, "*axes"], sin: Float[Array, "*axes"]) -> Float[Array, "*axes"]:
    """The angle [rad] of a unit vector: twice the arc tangent of the half angle's tangent."""
    steep = cos < 0.0  # beyond a right angle, computed from the other side
    angle = 2.0 * arc_tangent(sin / (1.0 + jnp.abs(cos)))
    return jnp.where(steep, jnp.sign(sin) * jnp.pi - angle, angle)


def arc_tangent(tangent: Float[Array, "*axes"]) -> Float[Array, "*axes"]:
    """The arc tangent [rad] of a number between -1 and 1, accurate to 1e-5 rad.

    It is the polynomial 4.4.49 of Abramowitz and Stegun: XLA's own goes value by value, and would take most of the time
    of a step.
    """
    square = tangent**2
    series = 0.9998660 + square * (-0.3302995 + square * (0.1801410 + square * (-0.0851330 + square * 0.0208351)))
    return tangent * series
