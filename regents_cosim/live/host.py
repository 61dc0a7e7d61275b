"""What an attack needs of the simulation that it is in: SUMO (`sumo_host`) or highway-env (`envs.live_adversary`)."""

from typing import Protocol

from regents_cosim.live.frame import Frame
from regents_cosim.live.plan import Plan
from regents_cosim.live.traffic import TrafficState
from regents_cosim.maps.roadmap import RoadMap


class VehicleControl(Protocol):
    """One vehicle in our hands, until it is given back as it was found."""

    name: str

    def follow_route_of(self, plan: Plan) -> None:
        """Let the vehicle's route be the way of the plan."""
        ...

    def confirm(self) -> None:
        """Called after every step of the simulation, before anything else."""
        ...

    def place(self, x: float, y: float, yaw: float, speed: float) -> None:
        """Where its centre [m] is to be after the next step, how it is turned [rad], and how fast it goes [m/s]."""
        ...

    def off_lane_m(self) -> float:
        """How far it is from the middle of its lane [m]."""
        ...

    def is_at_ease(self) -> bool:
        """Whether its own driver could go on from here without braking harder than it likes to."""
        ...

    def give_back(self) -> bool:
        """As it was found; False where it has gone, and needs nothing."""
        ...


class Host(Protocol):
    """A running simulation with one ego."""

    road: RoadMap
    step_s: float  # of the simulation
    speed_only: bool  # vehicles keep to their lanes, and nothing but their speed is ours

    def traffic(self, frame: Frame, most: int, horizon_s: float) -> TrafficState:
        """The ego and the nearest others, `most` in all, with what they are about to do."""
        ...

    def is_at_stop(self, name: str) -> bool:
        """Whether a vehicle waits at a stop of its own, or is parked: it is left there."""
        ...

    def is_spared(self, name: str) -> bool:
        """Whether a vehicle may not attack, whatever it does."""
        ...

    def take(self, name: str, length_m: float) -> VehicleControl:
        """Take a vehicle into our hands."""
        ...
