"""Planners of the CommonRoad family: what they plan from, as objects of commonroad-io, and a drive along their plans.

```py
class Mine(CommonRoadPlanner):
    def plan(self, observation):
        scenario, problem = self.scenario(observation), self.problem(observation)
        return ...  # the states of a trajectory, one a step from now on; none to brake
```

The scenario has the map, the others going on as they do over `horizon_steps`, and a wall at a red light.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import takewhile
from typing import Any

import numpy as np
from commonroad.common.util import Interval  # pyright: ignore[reportMissingImports]
from commonroad.geometry.shape import Rectangle  # pyright: ignore[reportMissingImports]
from commonroad.planning.goal import GoalRegion  # pyright: ignore[reportMissingImports]
from commonroad.planning.planning_problem import PlanningProblem  # pyright: ignore[reportMissingImports]
from commonroad.prediction.prediction import TrajectoryPrediction  # pyright: ignore[reportMissingImports]
from commonroad.scenario.obstacle import (  # pyright: ignore[reportMissingImports]
    DynamicObstacle,
    ObstacleType,
    StaticObstacle,
)
from commonroad.scenario.scenario import Scenario  # pyright: ignore[reportMissingImports]
from commonroad.scenario.state import CustomState, InitialState  # pyright: ignore[reportMissingImports]
from commonroad.scenario.trajectory import Trajectory  # pyright: ignore[reportMissingImports]
from jaxtyping import Float

from regents_cosim.norms.limits import ASSUMED_LIMIT_M_S
from regents_cosim.planners.adapters.seen import WALL_M, near, nearest, straight_on, wall_at_red
from regents_cosim.planners.interface import (
    MOST_PATHS,
    MOST_POINTS,
    WHEELBASE,
    AgentState,
    Control,
    Debug,
    Observation,
    Scene,
)

BEFORE_M, _BEYOND_M = 20, 200  # of the straight ends of a path
_FIRST_ID = 100_000  # of obstacles, beyond those of a map
_EGO_ID = 99_999
_MOST_EXPECTED = 8  # others in `Debug`
_KINDS = {
    "car": ObstacleType.CAR, "truck": ObstacleType.TRUCK, "bus": ObstacleType.BUS, "bicycle": ObstacleType.BICYCLE,
    "motorcycle": ObstacleType.MOTORCYCLE, "pedestrian": ObstacleType.PEDESTRIAN,
}  # fmt: skip


class CommonRoadPlanner(ABC):
    """Asks `plan` every few steps, and drives along the trajectory that it returns."""

    replan_steps = 3  # as in the examples of the reactive planner
    horizon_steps = 30  # for which the others are expected

    def reset(self, scene: Scene) -> None:
        """Begin a drive."""
        self.scene, self.network = scene, scene.commonroad()
        self._plan, self._age, self._last = list[Any](), 0, Control(0.0, 0.0)

    @abstractmethod
    def plan(self, observation: Observation) -> Sequence[Any]:
        """States of commonroad-io, `scene.dt` apart, the first for now; empty where there is no trajectory.

        Each has `velocity`; the ego steers by their `steering_angle` or, without it, along the route. It brakes from
        the first on whose speed or place is not finite.
        """
        ...

    def act(self, observation: Observation) -> Control:
        """The next control along the trajectory; hard braking where there is none."""
        self._age += 1
        if not self._plan or self._age >= self.replan_steps:
            planned = self.plan(observation)
            self._plan, self._age = list(takewhile(_is_finite, planned)), 0
            self._debug = self._thought(observation, cut=len(self._plan) < len(planned))
        ego, scene = observation.ego, observation.scene
        if self._age + 1 < len(self._plan):
            now, soon = self._plan[self._age : self._age + 2]
            accel, curvature = (soon.velocity - ego.speed) / scene.dt, self._curvature(ego, now, soon)
        else:
            accel, curvature = -ego.speed / scene.dt, self._last.curvature
        self._last = Control(
            float(np.clip(accel, -scene.max_accel, scene.max_accel)),
            float(np.clip(curvature, -scene.max_curvature, scene.max_curvature)),
            self._debug,
        )
        return self._last

    def weighed(self) -> Debug:
        """The candidates of the last plan, their costs and a text, for films and the player."""
        return Debug()

    def _thought(self, observation: Observation, cut: bool) -> Debug:
        """What was weighed, the trajectory that it takes, and where the nearest others are expected."""
        weighed, places = self.weighed(), [state.position for state in self._plan if hasattr(state, "position")]
        seconds = self.horizon_steps * self.scene.dt
        return replace(
            weighed,
            chosen=np.array(places)[:MOST_POINTS] if places else None,
            predictions=[straight_on(other, seconds) for other in nearest(observation, _MOST_EXPECTED)],
            text="; ".join(filter(None, [weighed.text, self._lacks(cut)])),
        )

    def _lacks(self, cut: bool) -> str:
        """What is wrong with the plan."""
        if cut:
            return f"from step {len(self._plan)} on its speed or place is not finite, there it brakes"
        return "" if self._plan else "none is left, it brakes"

    def _curvature(self, ego: AgentState, now: Any, soon: Any) -> float:
        first, second = (getattr(state, "steering_angle", None) for state in (now, soon))
        if first is None or second is None:
            return self.scene.route.pure_pursuit(ego.x, ego.y, ego.yaw, ego.speed)
        return float(np.tan(0.5 * (first + second))) / self.wheelbase

    @property
    def wheelbase(self) -> float:
        """The distance between the axles [m]."""
        return WHEELBASE * self.scene.ego.length

    @property
    def curvature(self) -> float:
        """The curvature that the ego drives now [1/m]."""
        return self._last.curvature

    @property
    def steering_angle(self) -> float:
        """The angle of the front wheels now [rad]."""
        return float(np.arctan(self._last.curvature * self.wheelbase))

    def path(self) -> Float[np.ndarray, "point 2"]:
        """The route [m] with straight ends, since planners ask for places before and beyond it."""
        route = self.scene.route
        along = [*range(-BEFORE_M, 0), *route.along.tolist(), *(route.length + np.arange(1, _BEYOND_M))]
        return np.array([route.at(float(place))[:2] for place in along])

    def speed_wanted(self, observation: Observation) -> float:
        """The speed limit here [m/s]; 50 km/h where the map has none."""
        limit = float(self.scene.route.ahead(float(observation.on_route.along), 1.0).speed_limit[0])
        return limit if np.isfinite(limit) else ASSUMED_LIMIT_M_S

    def state(self, observation: Observation) -> InitialState:
        """The ego now, at step 0."""
        return _state(observation.ego, 0, observation.acceleration, observation.yaw_rate)

    def state_as(self, kind: type[Any], observation: Observation) -> Any:
        """The ego now as a state with a steering angle, of the type that TUM's sampling planners have."""
        now = self.state(observation)
        known = {key: getattr(now, key) for key in ("time_step", "position", "orientation", "velocity", "acceleration")}
        return kind(**known, yaw_rate=now.velocity * self.curvature, steering_angle=self.steering_angle)

    def problem(self, observation: Observation) -> PlanningProblem:
        """From where the ego is now to its target."""
        ego, left = self.scene.ego, max(self.scene.steps - observation.step, 1)
        place = Rectangle(ego.length, ego.width, np.array(self.scene.target))
        goal = GoalRegion([CustomState(time_step=Interval(0, left), position=place)])
        return PlanningProblem(_EGO_ID, self.state(observation), goal)

    def scenario(self, observation: Observation) -> Scenario:
        """The map, and everything that the ego may not touch."""
        scenario = Scenario(self.scene.dt)
        scenario.add_objects(self.network)
        scenario.add_objects(list(self._obstacles(observation)))
        return scenario

    def _obstacles(self, observation: Observation) -> Iterator[DynamicObstacle | StaticObstacle]:
        for number, other in enumerate(near(observation)):
            shape = Rectangle(other.length, other.width)
            ahead = Trajectory(1, [_state(other, step, dt=self.scene.dt) for step in range(1, self.horizon_steps + 1)])
            kind, expected = _KINDS.get(other.kind, ObstacleType.UNKNOWN), TrajectoryPrediction(ahead, shape)
            yield DynamicObstacle(_FIRST_ID + number, kind, shape, _state(other, 0), expected)
        wall = wall_at_red(observation)
        if wall is not None:
            here = InitialState(0, np.array(wall[:2]), float(wall.yaw), 0.0)
            yield StaticObstacle(_EGO_ID - 1, ObstacleType.ROAD_BOUNDARY, Rectangle(WALL_M, 2 * 3.0), here)


def candidates(trajectories: Sequence[Any], text: str) -> Debug:
    """At most `MOST_PATHS` of TUM's trajectories and their costs, every few of them."""
    shown = trajectories[:: -(-len(trajectories) // MOST_PATHS) or 1]
    return Debug(
        candidates=[np.stack([one.cartesian.x, one.cartesian.y], axis=-1)[:MOST_POINTS] for one in shown],
        costs=[float(one.cost) for one in shown],
        text=text,
    )


def _is_finite(state: Any) -> bool:
    return bool(np.isfinite([state.velocity, *getattr(state, "position", ())]).all())


def _state(who: AgentState, step: int, accel: float = 0.0, yaw_rate: float = 0.0, dt: float = 0.0) -> InitialState:
    """A road user `step` steps from now, straight on at its speed."""
    way = who.speed * dt * step
    place = np.array([who.x + way * np.cos(who.yaw), who.y + way * np.sin(who.yaw)])
    return InitialState(step, place, who.yaw, who.speed, accel, yaw_rate, 0.0)
