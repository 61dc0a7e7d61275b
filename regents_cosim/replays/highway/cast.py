"""The scripted vehicles of a replay in highway-env, and the road that they drive on.

No vehicle is thrown off its track: highway-env moves and brakes vehicles that touch, which scripted
ones undo; that they touched is noted.
"""

from typing import Any

import numpy as np
from highway_env.road.lane import AbstractLane
from highway_env.road.road import LaneIndex, Road, RoadNetwork
from highway_env.vehicle.kinematics import Vehicle
from jaxtyping import Float

from regents_cosim.geometry.frames import Pose, to_highway, wheel_from_curvature
from regents_cosim.scenario import Scenario

_COLOURS = {"ego": (0, 114, 178), "adversary": (213, 94, 0), "background": (150, 150, 150)}


class ScriptedVehicle(Vehicle):
    """A vehicle on its track. `moment` is the step of the track that it is at."""

    def __init__(self, road: Road, scenario: Scenario, row: int) -> None:
        """The agent of `scenario` in that `row`."""
        agent, tracks = scenario.agents[row], scenario.tracks
        self.LENGTH, self.WIDTH = agent.length, agent.width  # highway-env takes the diagonal of them right away
        x, y, heading = to_highway(Pose(tracks.x[row], tracks.y[row], tracks.yaw[row]))
        self.states = np.stack([x, y, heading, tracks.speed[row]])
        self.valid = tracks.valid[row]
        self.name, self.role = agent.id, agent.role
        self.color = _COLOURS[agent.role]
        self.moment = 0
        first = self.states[:, np.argmax(self.valid)]
        super().__init__(road, first[:2], float(first[2]), float(first[3]))
        self.check_collisions = agent.role == "ego"  # two others never need to be held against each other
        self.route: list[LaneIndex] = []  # intersection takes vehicles without one off the road

    def act(self, action: Any = None) -> None:
        """Nothing to decide."""

    def step(self, dt: float) -> None:
        """The next step of the track."""
        self.moment += 1
        self.place()

    def place(self) -> None:
        """Be where the track is at `moment`."""
        x, y, heading, speed = self.states[:, min(self.moment, self.states.shape[1] - 1)].tolist()
        self.position = np.array([x, y])
        self.heading, self.speed = heading, speed
        self.impact = None

    @property
    def present(self) -> bool:
        """Whether it is there at `moment`."""
        return self.moment < len(self.valid) and bool(self.valid[self.moment])

    def predict_trajectory_constant_speed(self, times: np.ndarray) -> tuple[list[np.ndarray], list[float]]:
        """Straight on: the general way copies the road with all agents on it."""
        return [self.position + self.speed * t * self.direction for t in times], [self.heading] * len(times)

    # Looking for the closest among all lanes costs more than everything else a scripted vehicle
    # does, so it is done when it is asked for.

    @property
    def lane_index(self) -> LaneIndex | None:
        """The lane that it is on."""
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
        """The lane that it is on."""
        index = self.lane_index
        return None if index is None else self.road.network.get_lane(index)

    @lane.setter
    def lane(self, lane: AbstractLane | None) -> None:
        pass


class ActionVehicle(ScriptedVehicle):
    """A vehicle that highway-env's own physics moves, by the actions that its track stands for."""

    def __init__(self, road: Road, scenario: Scenario, row: int, controls: Float[np.ndarray, "2 step"]) -> None:
        """`controls` are accelerations [m/s^2] and curvatures [1/m] in our frame."""
        super().__init__(road, scenario, row)
        self.accel = controls[0]
        self.steering = np.asarray(wheel_from_curvature(controls[1], self.LENGTH))

    def step(self, dt: float) -> None:
        """One step of highway-env's vehicle, as if nothing had touched it; at first, be on the track."""
        self.moment += 1
        if self.moment == len(self.valid) or not self.valid[self.moment - 1]:
            self.place()
            return
        before = self.moment - 1
        # highway-env would reverse where the mirror's vehicles stop
        accel = max(self.accel[before], -self.speed / dt)
        self.action = {"acceleration": accel, "steering": self.steering[before]}
        crashed, self.crashed, self.impact = self.crashed, False, None
        super(ScriptedVehicle, self).step(dt)
        self.crashed = crashed

    def on_state_update(self) -> None:
        """The lane is looked up when it is asked for."""


class ReplayRoad(Road):
    """A road whose scripted vehicles come and go; the ego is always the first vehicle.

    `contacts` are the ego's, by highway-env's judgement: step and name of the other. Scripted
    vehicles are held against the ego alone: what they do to each other is known.
    """

    def __init__(self, network: RoadNetwork, np_random: np.random.Generator) -> None:
        super().__init__(network, np_random=np_random)  # pyright: ignore[reportArgumentType]
        self.cast: list[ScriptedVehicle] = []
        self.contacts: list[tuple[int, str]] = []
        self.moment = 0

    def enter(self, ego: Vehicle, cast: list[ScriptedVehicle]) -> None:
        """All that are there at the first step."""
        self.cast = cast
        self.vehicles = [ego]
        self.look(0.0)

    def step(self, dt: float) -> None:
        """Move all agents, see who comes and goes, and who touches the ego."""
        self.moment += 1
        for vehicle in (self.vehicles[0], *self.cast):
            vehicle.step(dt)
        self.look(dt)

    def look(self, dt: float) -> None:
        """See who is there, and who touches the ego."""
        self.vehicles = [self.vehicles[0], *(vehicle for vehicle in self.cast if vehicle.present)]
        ego = self.vehicles[0]
        for other in self.vehicles[1:]:
            if isinstance(other, ScriptedVehicle) and _touch(ego, other, dt):
                self.contacts.append((self.moment, other.name))


def _touch(ego: Vehicle, other: ScriptedVehicle, dt: float) -> bool:
    """Let highway-env handle the pair; whether it says that they touch."""
    known = ego.crashed, other.crashed
    ego.crashed = other.crashed = False
    ego.handle_collisions(other, dt)
    touch = ego.crashed
    ego.crashed, other.crashed = known[0] or touch, known[1] or touch
    return touch
