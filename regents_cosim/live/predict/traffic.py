"""Traffic at one instant, as plans need it: states, routes and car-following. This module does not depend on SUMO."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from regents_cosim.live.predict.paths import Path
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.scenario.scenario import Agent

CarFollowingModel = Literal["krauss", "idm", "improved_idm"]
PredictedDrive = Float[np.ndarray, "4 time"]  # x, y [m], yaw [rad], speed [m/s] at every step of a prediction
Shows = tuple[tuple[float, str], ...]  # times [s] from now and the letters that a light shows from then on


@dataclass(frozen=True)
class Following:
    """Car-following parameters of a vehicle, in SUMO's terms."""

    accel: float = 2.6  # [m/s^2]
    decel: float = 4.5  # [m/s^2]
    tau_s: float = 1.0  # wanted headway
    min_gap_m: float = 2.5
    speed_factor: float = 1.0  # times the speed limit
    max_speed_m_s: float = 55.6
    sigma: float = 0.0  # dawdling in Krauss' model
    model: CarFollowingModel = "improved_idm"


@dataclass(frozen=True, eq=False)
class RoadUser:
    """A vehicle: box centre in the map's frame."""

    agent: Agent
    x: float  # [m]
    y: float  # [m]
    yaw: float  # [rad]
    speed: float  # [m/s]
    path: Path  # from its front bumper on
    following: Following = Following()
    z: float = 0.0  # [m] of the road
    accel: float = np.nan  # [m/s^2] recent, where known
    drive: PredictedDrive | None = None  # its future motion where known: an adversary's plan


@dataclass(frozen=True, eq=False)
class TrafficState:
    """The ego, which comes first, the vehicles near it, and the lights."""

    time_s: float
    users: tuple[RoadUser, ...]  # the ego first, then by increasing id
    road: RoadMap
    lights: dict[str, Shows]  # by the id of the signal
    way: Float[np.ndarray, "point 2"] | None = None  # [m] the line that the ego's planner drives along, where known

    @property
    def ego(self) -> RoadUser:
        """The vehicle that the planner drives."""
        return self.users[0]

    def values(self, name: str) -> Float[np.ndarray, " user"]:
        """One field of all users as an array."""
        return np.array([getattr(user, name) for user in self.users], float)

    def driving(self, known: Mapping[str, PredictedDrive]) -> "TrafficState":
        """The traffic with the `known` drives of some users, by id."""
        users = tuple(replace(user, drive=known.get(user.agent.id, user.drive)) for user in self.users)
        return replace(self, users=users) if known else self

    def index(self, agent: str) -> int | None:
        """The index of an agent among the users; None where it is absent."""
        return next((k for k, user in enumerate(self.users) if user.agent.id == agent), None)
