"""Road users at one instant, as arrays."""

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from regents_cosim.scenario import Scenario


@runtime_checkable
class Bodies(Protocol):
    """Road users at one instant; `Observation.others` is such."""

    @property
    def x(self) -> Float[np.ndarray, " agent"]:
        """East [m]."""
        ...

    @property
    def y(self) -> Float[np.ndarray, " agent"]:
        """North [m]."""
        ...

    @property
    def yaw(self) -> Float[np.ndarray, " agent"]:
        """Heading [rad]."""
        ...

    @property
    def speed(self) -> Float[np.ndarray, " agent"]:
        """Speed [m/s]."""
        ...

    @property
    def z(self) -> Float[np.ndarray, " agent"] | float:
        """Height of the road [m]."""
        ...

    @property
    def length(self) -> Float[np.ndarray, " agent"]:
        """Length [m]."""
        ...

    @property
    def width(self) -> Float[np.ndarray, " agent"]:
        """Width [m]."""
        ...

    @property
    def valid(self) -> Bool[np.ndarray, " agent"]:
        """Whether each is there."""
        ...


class AtFirst(NamedTuple):
    """All but the ego at the first step of a scene."""

    x: Float[np.ndarray, " agent"]
    y: Float[np.ndarray, " agent"]
    yaw: Float[np.ndarray, " agent"]
    speed: Float[np.ndarray, " agent"]
    z: Float[np.ndarray, " agent"]
    length: Float[np.ndarray, " agent"]
    width: Float[np.ndarray, " agent"]
    valid: Bool[np.ndarray, " agent"]

    @classmethod
    def of(cls, scenario: Scenario) -> "AtFirst":
        """The others of a scenario."""
        tracks, others = scenario.tracks, scenario.agents[1:]
        length, width = (np.array([getattr(one, name) for one in others], float) for name in ("length", "width"))
        state = tracks.x, tracks.y, tracks.yaw, tracks.speed, tracks.z
        x, y, yaw, speed, z = (values[1:, 0] for values in state)
        return cls(x, y, yaw, speed, z, length, width, tracks.valid[1:, 0])
