"""The vehicles around the ego after one step of a simulation."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from regents_cosim.geometry.boxes import Boxes, distance
from regents_cosim.simulators.sumo.types import VehicleType


@dataclass(frozen=True, eq=False)
class Frame:
    """The vehicles around the ego, which comes first: box centres in the map's frame."""

    time_s: float
    ids: tuple[str, ...]
    x: Float[np.ndarray, " vehicle"]  # [m]
    y: Float[np.ndarray, " vehicle"]  # [m]
    yaw: Float[np.ndarray, " vehicle"]  # [rad]
    speed: Float[np.ndarray, " vehicle"]  # [m/s]
    z: Float[np.ndarray, " vehicle"]  # [m] of the road
    types: tuple[VehicleType, ...]
    lights: dict[str, str]  # letters by the id of the signal

    @cached_property
    def boxes(self) -> Boxes:
        """The box of each vehicle."""
        length = np.array([kind.length for kind in self.types])
        width = np.array([kind.width for kind in self.types])
        return Boxes(self.x, self.y, self.yaw, length, width, self.z)

    @cached_property
    def number(self) -> dict[str, int]:
        """The row of each vehicle, by id."""
        return {name: index for index, name in enumerate(self.ids)}

    def nearest(self, most: int) -> list[int]:
        """The rows of the ego and of the nearest others, sorted by name; at most `most` in all."""
        order = np.argsort(np.hypot(self.x - self.x[0], self.y - self.y[0]), kind="stable")
        others = [int(row) for row in order if row != 0][: most - 1]
        return [0, *sorted(others, key=lambda row: self.ids[row])]

    def gap_m(self, name: str) -> float:
        """The distance between the boxes of the ego and of another vehicle [m]."""
        ego, other = (Boxes(*(np.asarray(v)[k] for v in self.boxes)) for k in (0, self.number[name]))
        return float(distance(ego, other))
