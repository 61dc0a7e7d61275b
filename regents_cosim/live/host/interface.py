"""The interface of the simulation of a live attack: SUMO (`attacked_ego`) and highway-env (`envs.live_adversary`).

After each step such a host shows the vehicles around the ego as a `Frame`.
"""

from collections import deque
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from jaxtyping import Float

from regents_cosim.geometry.boxes import Boxes, overlap
from regents_cosim.live.predict.traffic import TrafficState
from regents_cosim.live.search.plan import Plan
from regents_cosim.maps.roadmap import RoadMap
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


_RECENT_S = 3.0
OFF_LANE_M = 0.3  # a vehicle is released this close to the middle of a lane


class History:
    """The frames of the last `horizon_s` [s], without gaps; append each new one to `frames`."""

    def __init__(self, horizon_s: float, step_s: float) -> None:
        self.frames: deque[Frame] = deque(maxlen=max(round(horizon_s / step_s), 1) + 1)

    def recent_m_s(self) -> float:
        """The ego's highest speed in the last 3 s."""
        last = self.frames[-1].time_s
        return max(float(frame.speed[0]) for frame in self.frames if last - frame.time_s <= _RECENT_S)


def touched(frame: Frame) -> list[str]:
    """The ids of the others that the ego touches."""
    boxes = frame.boxes
    hits = np.asarray(overlap(boxes.at(0), boxes))
    hits[0] = False
    return [frame.ids[index] for index in np.flatnonzero(hits)]


class VehicleControl(Protocol):
    """Control over one vehicle, until it is released."""

    def follow_route_of(self, plan: Plan) -> None:
        """Set the vehicle's route to the path of the plan."""

    def confirm(self) -> None:
        """Called after every step of the simulation, before anything else."""

    def place(self, x: float, y: float, yaw: float, speed: float) -> None:
        """Set the centre [m], the yaw [rad] and the speed [m/s] for the next step."""

    def is_at_ease(self) -> bool:
        """Whether it is within `OFF_LANE_M` of the middle of its lane, and its own driver could take over without
        braking harder than it likes.
        """
        ...

    def give_back(self) -> bool:
        """Restore the vehicle's own driver; returns False where the vehicle has gone."""
        ...


class Host(Protocol):
    """A running simulation with one ego."""

    road: RoadMap
    step_s: float  # of the simulation
    speed_only: bool  # vehicles keep to their lanes, and only their speed can be controlled

    def traffic(self, frame: Frame, most: int, horizon_s: float) -> TrafficState:
        """The ego and the nearest others, at most `most` in all, with their expected motion."""
        ...

    def is_at_stop(self, name: str) -> bool:
        """Whether a vehicle waits at a scheduled stop, or is parked; such a vehicle is left alone."""
        ...

    def is_spared(self, name: str) -> bool:
        """Whether a vehicle may never attack."""
        ...

    def take(self, name: str, length_m: float) -> VehicleControl:
        """Take control of a vehicle."""
        ...
