"""Turn waypoints into controls: PID on speed, pure pursuit on the path, in the units of the bicycle model.

The published gains belong to CARLA's pedals and steering wheel. Here the controls are acceleration and curvature:
constant acceleration a over the waypoints' 0.8 s makes their mean speed differ from the present one by 0.4 s times a,
and the circle through the last waypoint leads to it.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.mirror.programs.on_device import on_device
from regents_cosim.norms.limits import ACCEL_LIMIT
from regents_cosim.planners.aim_bev.architecture import WAYPOINT_S, WAYPOINTS

_WINDOW = 8  # errors that the integral and the derivative use, as published
_STANDING_M_S = 0.6  # a slower path means to stop, as published
_LEAST_WAY_M2 = 0.25  # squared; waypoints nearer than 0.5 m give no direction


class SpeedErrors(eqx.Module):
    """The controller's state: errors of the desired speed, the latest last."""

    speed: Float[Array, " window"]  # [m/s]


class Controller(eqx.Module):
    """Gains of the speed controller per second, per second squared, and without unit."""

    proportional: float = 2.5
    brake_ratio: float = 1.03  # faster than the path by this factor: full brake (1.1 as published)
    integral: float = 0.0
    derivative: float = 0.0

    def begin(self) -> SpeedErrors:
        """The state at the begin, without errors."""
        return SpeedErrors(on_device(np.zeros(_WINDOW), np.float32))

    def steer(
        self, errors: SpeedErrors, waypoints: Float[Array, "waypoint 2"], speed: Float[Array, ""]
    ) -> tuple[ControlArrays, SpeedErrors]:
        """Controls along `waypoints` [m, ego frame, x ahead] at the present `speed` [m/s], and the next state."""
        steps = jnp.diff(waypoints, axis=0, prepend=jnp.zeros((1, 2)))
        desired = jnp.hypot(steps[:, 0], steps[:, 1]).sum() / (WAYPOINTS * WAYPOINT_S)
        desired = jnp.where((desired < _STANDING_M_S) | (waypoints[-1, 0] < 0.0), 0.0, desired)
        errors = SpeedErrors(jnp.append(errors.speed[1:], desired - speed))
        accel = (
            self.proportional * errors.speed[-1]
            + self.integral * errors.speed.mean()
            + self.derivative * (errors.speed[-1] - errors.speed[-2])
        )
        accel = jnp.where(speed > self.brake_ratio * desired, -ACCEL_LIMIT, accel)
        accel = jnp.where(desired == 0.0, -jnp.minimum(speed / WAYPOINT_S, ACCEL_LIMIT), accel)
        ahead, left = waypoints[-1]
        return ControlArrays(accel, 2.0 * left / jnp.maximum(ahead**2 + left**2, _LEAST_WAY_M2)), errors
