"""Remember the last drive through a scene, so that a plan is not computed again where nothing in view is new.

An attack moves few agents, and those mostly out of sight at first, so most of its drives begin like the one before. The
plan is the same to the last bit, because everything that it depends on is the same.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.camera import Camera
from regents_cosim.mirror.observe import MARK_S, Surroundings
from regents_cosim.mirror.on_device import on_device
from regents_cosim.planners.aim_bev.architecture import WAYPOINTS

_VALUES = 6  # values that describe an agent's look


class LastDrive(eqx.Module):
    """Everything in view at every step, and the plan; NaN where nothing was seen yet."""

    seen: Float[Array, "*time value"]
    waypoints: Float[Array, "*time waypoint 2"]  # [m]

    @classmethod
    def of_nothing(cls, steps: int, others: int) -> "LastDrive":
        """The record before the first drive among `others` other agents."""
        shapes = (steps, 4 + _VALUES * others), (steps, WAYPOINTS, 2)
        return cls(*(on_device(np.full(shape, np.nan), np.float32) for shape in shapes))

    def at(self, step: Int[Array, ""]) -> "LastDrive":
        """The record of one step."""
        return jax.tree.map(lambda values: values[step], self)

    def put(self, step: Int[Array, ""], instant: "LastDrive") -> "LastDrive":
        """The record with `instant` at a step."""
        return jax.tree.map(lambda values, value: values.at[step].set(value), self, instant)


def in_view(view: Surroundings, ego: Motion, camera: Camera) -> Float[Array, " value"]:
    """Everything on which the picture by `camera` depends at one step: the ego, and agents near enough to be drawn."""
    box = view.boxes
    length = box.half_length + MARK_S * jnp.abs(view.speed)
    near = jnp.hypot(box.x - ego.x, box.y - ego.y) < camera.reach_m + jnp.hypot(length, box.half_width) + 1.0
    looks = jnp.stack([box.x, box.y, box.cos, box.sin, view.speed, view.valid.astype(jnp.float32)])
    own = jnp.stack([ego.x, ego.y, ego.yaw, ego.speed])
    return jnp.concatenate([own, jnp.where(near, looks, jnp.inf).ravel()])
