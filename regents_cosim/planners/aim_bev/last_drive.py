"""What the last drive through a scene has shown: where nothing in view is new, the plan is not made again.

An attack moves few agents, and those mostly out of sight at first, so that most of its drives begin as the one before.
The plan is the same to the last bit, because all that it depends on is.
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

_VALUES = 6  # that say how an agent looks


class LastDrive(eqx.Module):
    """Of every step all that was in view, and the plan; NaN where nothing was seen yet."""

    seen: Float[Array, "*time value"]
    waypoints: Float[Array, "*time waypoint 2"]  # [m]

    @classmethod
    def of_nothing(cls, steps: int, others: int) -> "LastDrive":
        """Before the first drive among so many `others`."""
        shapes = (steps, 4 + _VALUES * others), (steps, WAYPOINTS, 2)
        return cls(*(on_device(np.full(shape, np.nan), np.float32) for shape in shapes))

    def at(self, step: Int[Array, ""]) -> "LastDrive":
        """One step of it."""
        return jax.tree.map(lambda values: values[step], self)

    def put(self, step: Int[Array, ""], instant: "LastDrive") -> "LastDrive":
        """The same with another `instant` at a step."""
        return jax.tree.map(lambda values, value: values.at[step].set(value), self, instant)


def in_view(view: Surroundings, ego: Motion, camera: Camera) -> Float[Array, " value"]:
    """All that a picture by `camera` of a scene at one step depends on: the ego, and who is near enough to be drawn."""
    box = view.boxes
    length = box.half_length + MARK_S * jnp.abs(view.speed)
    near = jnp.hypot(box.x - ego.x, box.y - ego.y) < camera.reach_m + jnp.hypot(length, box.half_width) + 1.0
    looks = jnp.stack([box.x, box.y, box.cos, box.sin, view.speed, view.valid.astype(jnp.float32)])
    own = jnp.stack([ego.x, ego.y, ego.yaw, ego.speed])
    return jnp.concatenate([own, jnp.where(near, looks, jnp.inf).ravel()])
