"""The interface of the simulation of a live attack: SUMO (`attacked_ego`) and highway-env (`envs.live_adversary`)."""

from typing import Protocol

from regents_cosim.live.host.frame import Frame
from regents_cosim.live.predict.traffic import TrafficState
from regents_cosim.live.search.plan import Plan
from regents_cosim.maps.roadmap import RoadMap


class VehicleControl(Protocol):
    """Control over one vehicle, until it is released."""

    name: str

    def follow_route_of(self, plan: Plan) -> None:
        """Set the vehicle's route to the path of the plan."""
        ...

    def confirm(self) -> None:
        """Called after every step of the simulation, before anything else."""
        ...

    def place(self, x: float, y: float, yaw: float, speed: float) -> None:
        """Set the centre [m], the yaw [rad] and the speed [m/s] for the next step."""
        ...

    def off_lane_m(self) -> float:
        """The distance of the vehicle from the centre line of its lane [m]."""
        ...

    def is_at_ease(self) -> bool:
        """Whether its own driver could take over without braking harder than it likes."""
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
