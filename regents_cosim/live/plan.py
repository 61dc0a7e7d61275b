"""What one adversary is to do."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from regents_cosim.live.moments import DT_S, Drive


@dataclass(frozen=True, eq=False)
class Plan:
    """What one adversary does from a time on: box centres in the map's frame, every `DT_S`."""

    adversary: str
    begun_s: float
    x: Float[np.ndarray, " time"]  # [m]
    y: Float[np.ndarray, " time"]  # [m]
    yaw: Float[np.ndarray, " time"]  # [rad] continuous
    speed: Float[np.ndarray, " time"]  # [m/s]
    meets_s: float  # when it would meet the ego
    iterations: int = 0
    rollouts: int = 1

    def at(self, time_s: float) -> tuple[float, float, float, float]:
        """X, y [m], yaw [rad] and speed [m/s] at a time; straight on after its end."""
        since = time_s - self.begun_s
        own = np.arange(len(self.x)) * DT_S
        x, y, yaw, speed = (float(np.interp(since, own, v)) for v in (self.x, self.y, self.yaw, self.speed))
        beyond = max(since - own[-1], 0.0) * speed
        return x + beyond * float(np.cos(yaw)), y + beyond * float(np.sin(yaw)), yaw, speed

    def rest(self, time_s: float, steps: int) -> Drive:
        """What is left of it from a time on, as long as `steps` instants."""
        return np.array([self.at(time_s + step * DT_S) for step in range(steps)]).T
