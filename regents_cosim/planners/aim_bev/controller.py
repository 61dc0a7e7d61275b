"""Turn waypoints into controls: a speed controller, and pure pursuit on the path, in the units of the bicycle model.

The published gains belong to CARLA's pedals and steering wheel. Here the controls are acceleration and curvature:
constant acceleration a over the waypoints' 0.8 s makes their mean speed differ from the present one by 0.4 s times a,
and the circle through the last waypoint leads to it.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.norms.limits import ACCEL_LIMIT
from regents_cosim.planners.aim_bev.architecture import WAYPOINT_S, WAYPOINTS

_GAIN = 2.5  # [1/s] of the speed; the published integral and derivative have no part here
_BRAKE_RATIO = 1.03  # faster than the path by this factor: full brake (1.1 as published)
_STANDING_M_S = 0.6  # a slower path means to stop, as published
_LEAST_WAY_M2 = 0.25  # squared; waypoints nearer than 0.5 m give no direction


def steer(waypoints: Float[Array, "waypoint 2"], speed: Float[Array, ""]) -> ControlArrays:
    """Controls along `waypoints` [m, ego frame, x ahead] at the present `speed` [m/s]."""
    steps = jnp.diff(waypoints, axis=0, prepend=jnp.zeros((1, 2)))
    desired = jnp.hypot(steps[:, 0], steps[:, 1]).sum() / (WAYPOINTS * WAYPOINT_S)
    desired = jnp.where((desired < _STANDING_M_S) | (waypoints[-1, 0] < 0.0), 0.0, desired)
    accel = jnp.where(speed > _BRAKE_RATIO * desired, -ACCEL_LIMIT, _GAIN * (desired - speed))
    accel = jnp.where(desired == 0.0, -jnp.minimum(speed / WAYPOINT_S, ACCEL_LIMIT), accel)
    ahead, left = waypoints[-1]
    return ControlArrays(accel, 2.0 * left / jnp.maximum(ahead**2 + left**2, _LEAST_WAY_M2))
