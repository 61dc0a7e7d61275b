"""The scripted vehicles of a replay in highway-env, and the road that they drive on.

highway-env moves and brakes vehicles that touch; scripted vehicles ignore this, stay on their tracks, and the contact
is noted.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from highway_env.road.lane import AbstractLane
from highway_env.road.road import LaneIndex, Road, RoadNetwork
from highway_env.vehicle.kinematics import Vehicle
from jaxtyping import Float

from regents_cosim.geometry.frames import Pose, to_highway, wheel_from_curvature
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.simulators import COLOURS


class ScriptedVehicle(Vehicle):
    """A vehicle on its track. `moment` is its current step of the track."""

    def __init__(self, road: Road, scenario: Scenario, row: int) -> None:
        """The vehicle of the agent in row `row` of `scenario`."""
        agent, tracks = scenario.agents[row], scenario.tracks
        self.LENGTH, self.WIDTH = agent.length, agent.width  # highway-env computes the diagonal from them at once
        x, y, heading = to_highway(Pose(tracks.x[row], tracks.y[row], tracks.yaw[row]))
        self.states = np.stack([x, y, heading, tracks.speed[row]])
        self.valid = tracks.valid[row]
        self.name, self.role = agent.id, agent.role
        self.color = COLOURS[agent.role]
        self.moment = 0
        first = self.states[:, np.argmax(self.valid)]
        super().__init__(road, first[:2], float(first[2]), float(first[3]))
        self.check_collisions = agent.role == "ego"  # contacts among the others are known from the case
        self.route: list[LaneIndex] = []  # the intersection environment removes vehicles without a route

    def act(self, action: Any = None) -> None:
        """Ignore actions, since the track decides."""

    def step(self, dt: float) -> None:
        """Go to the next step of the track."""
        self.moment += 1
        self.place()

    def place(self) -> None:
        """Take the pose that the track has at `moment`."""
        x, y, heading, speed = self.states[:, min(self.moment, self.states.shape[1] - 1)].tolist()
        self.position = np.array([x, y])
        self.heading, self.speed = heading, speed
        self.impact = None

    @property
    def present(self) -> bool:
        """Whether the agent is present at `moment`."""
        return self.moment < len(self.valid) and bool(self.valid[self.moment])

    def predict_trajectory_constant_speed(self, times: np.ndarray) -> tuple[list[np.ndarray], list[float]]:
        """Predict straight motion; highway-env's general method would copy the road with all its agents."""
        return [self.position + self.speed * t * self.direction for t in times], [self.heading] * len(times)

    # The search for the closest lane costs more than all else that a scripted vehicle does, so it runs on demand.

    @property
    def lane_index(self) -> LaneIndex | None:
        """The index of the vehicle's lane."""
        at = (*self.position.tolist(), self.heading)
        if getattr(self, "_looked_up", None) != at:
            self._looked_up = at
            self._lane_index = self.road.network.get_closest_lane_index(self.position, self.heading)
        return self._lane_index

    @lane_index.setter
    def lane_index(self, index: LaneIndex | None) -> None:
        pass

    @property
    def lane(self) -> AbstractLane | None:
        """The vehicle's lane."""
        index = self.lane_index
        return None if index is None else self.road.network.get_lane(index)

    @lane.setter
    def lane(self, lane: AbstractLane | None) -> None:
        pass


class ActionVehicle(ScriptedVehicle):
    """A vehicle that highway-env's own physics moves by the actions computed from its track."""

    def __init__(self, road: Road, scenario: Scenario, row: int, controls: Float[np.ndarray, "2 step"]) -> None:
        """`controls` are accelerations [m/s^2] and curvatures [1/m] in the map's frame."""
        super().__init__(road, scenario, row)
        self.accel = controls[0]
        self.steering = np.asarray(wheel_from_curvature(controls[1], self.LENGTH))

    def step(self, dt: float) -> None:
        """One step of highway-env's vehicle, ignoring contacts; the first step puts the vehicle on its track."""
        self.moment += 1
        if self.moment == len(self.valid) or not self.valid[self.moment - 1]:
            self.place()
            return
        before = self.moment - 1
        # here highway-env would reverse, while the mirror's vehicles stop
        accel = max(self.accel[before], -self.speed / dt)
        self.action = {"acceleration": accel, "steering": self.steering[before]}
        crashed, self.crashed, self.impact = self.crashed, False, None
        super(ScriptedVehicle, self).step(dt)
        self.crashed = crashed

    def on_state_update(self) -> None:
        """Do nothing, since the lane is looked up on demand."""


class ReplayRoad(Road):
    """A road on which scripted vehicles appear and disappear; the ego is always the first vehicle.

    `contacts` are those of the ego as highway-env detects them: step and name of the other. Scripted vehicles are
    checked against the ego only, since their contacts with each other are known from the case.
    """

    def __init__(self, network: RoadNetwork, np_random: np.random.Generator) -> None:
        super().__init__(network, np_random=np_random)  # pyright: ignore[reportArgumentType]
        self.cast: list[Any] = []  # scripted vehicles; in a planner's copy those that drive by themselves
        self.contacts: list[tuple[int, str]] = []
        self.moment = 0

    def enter(self, ego: Vehicle, cast: Sequence[Vehicle]) -> None:
        """Add all agents that are present at the first step."""
        self.cast = list(cast)
        self.vehicles = [ego]
        self.look(0.0)

    def step(self, dt: float) -> None:
        """Move all agents, add and remove vehicles, and find contacts of the ego."""
        self.moment += 1
        for vehicle in (self.vehicles[0], *self.cast):
            vehicle.step(dt)
        self.look(dt)

    def look(self, dt: float) -> None:
        """Add and remove vehicles, and find contacts of the ego."""
        self.vehicles = [self.vehicles[0], *(vehicle for vehicle in self.cast if vehicle.present)]
        ego = self.vehicles[0]
        for other in self.vehicles[1:]:
            if _touch(ego, other, dt):
                self.contacts.append((self.moment, other.name))


def _touch(ego: Vehicle, other: Any, dt: float) -> bool:
    """Let highway-env handle a pair, and return whether it detects a contact."""
    known = ego.crashed, other.crashed
    ego.crashed = other.crashed = False
    ego.handle_collisions(other, dt)
    touch = ego.crashed
    ego.crashed, other.crashed = known[0] or touch, known[1] or touch
    return touch
