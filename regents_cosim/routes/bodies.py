"""Road users at one instant, as arrays."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from regents_cosim.scenario.scenario import Agent


@dataclass(frozen=True, eq=False)
class Bodies:
    """Road users at one instant, as arrays in the order of `agents`; `Observation.others` is such."""

    agents: tuple[Agent, ...]
    x: Float[np.ndarray, " agent"]  # [m] 0 where absent, like all below
    y: Float[np.ndarray, " agent"]  # [m]
    yaw: Float[np.ndarray, " agent"]  # [rad]
    speed: Float[np.ndarray, " agent"]  # [m/s]
    valid: Bool[np.ndarray, " agent"]  # is present
    z: Float[np.ndarray, " agent"] | float = 0.0  # [m] height of the road, which differs on a bridge

    def __post_init__(self) -> None:
        if np.shape(self.z) != self.x.shape:
            object.__setattr__(self, "z", np.broadcast_to(self.z, self.x.shape))

    @property
    def length(self) -> Float[np.ndarray, " agent"]:
        """Lengths [m]."""
        return np.array([agent.length for agent in self.agents], float)

    @property
    def width(self) -> Float[np.ndarray, " agent"]:
        """Widths [m]."""
        return np.array([agent.width for agent in self.agents], float)
