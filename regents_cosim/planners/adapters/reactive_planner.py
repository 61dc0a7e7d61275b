"""The sampling-based planner of `commonroad-reactive-planner`, at the wheel of an ego.

    pip install commonroad-reactive-planner numpy msgspec shapely jaxtyping    # in an environment of its own
    --planner python:ENVIRONMENT/bin/python:regents_cosim.planners.adapters.reactive_planner:ReactivePlanner

It follows `Scene.route` at the speed limit, expects the others to go on as they do, and stops at red lights.
Source: Werling et al., Optimal Trajectory Generation for Dynamic Street Scenarios in a Frenet Frame, ICRA 2010.
"""

import logging
from itertools import pairwise

import numpy as np
import shapely
from commonroad.scenario.scenario import Scenario  # pyright: ignore[reportMissingImports]
from commonroad_clcs.config import CLCSParams  # pyright: ignore[reportMissingImports]
from commonroad_clcs.pycrccosy import (  # pyright: ignore[reportMissingImports]
    CartesianProjectionDomainError,
    CurvilinearProjectionDomainLateralError,
)
from commonroad_dc import pycrcc  # pyright: ignore[reportMissingImports]
from commonroad_rp.reactive_planner import ReactivePlanner as Package  # pyright: ignore[reportMissingImports]
from commonroad_rp.state import ReactivePlannerState  # pyright: ignore[reportMissingImports]
from commonroad_rp.utility.config import (  # pyright: ignore[reportMissingImports]
    ReactivePlannerConfiguration,
    VehicleConfiguration,
)
from commonroad_rp.utility.utils_coordinate_system import CoordinateSystem  # pyright: ignore[reportMissingImports]

from regents_cosim.planners.interface import WHEELBASE, AgentState, Control, Observation, Scene

_REPLAN_STEPS = 3  # as in the package's examples
_LEVELS = 3  # of the density of samples; one more takes seconds where nothing is feasible
_SPEED_M_S = 13.9  # where the map has no limits
_STANDS_M_S = 0.01  # at 0 the package looks for a planning problem
_SEEN_M = 80.0
_BEFORE_M, _BEYOND_M = 20, 200
_KERB_M = 0.1  # width of the edge of the road
_WALL_M = 0.5  # thickness of the wall that stands at a red light
_BRAKE_M_S2 = 6.0  # without a trajectory
_STOPS_M_S2 = 4.0  # a light that needs harder braking is passed

# What the package raises where the ego has left the reference path, and where it stands and cannot move: then it fails
# to print a cost that it does not have (TypeError).
_NO_PLAN = (ValueError, CartesianProjectionDomainError, CurvilinearProjectionDomainLateralError, TypeError)


class ReactivePlanner:
    """Asks the package for a trajectory every 0.3 s at 10 Hz, and drives along it."""

    def reset(self, scene: Scene) -> None:
        """Begin a drive: the route becomes the reference path."""
        logging.getLogger("RP_LOGGER").setLevel(logging.ERROR)
        self._config = _config(scene)
        self._planner = Package(self._config)
        path = CoordinateSystem(_reference(scene), clcs_params=CLCSParams())
        self._planner.set_reference_path(coordinate_system=path)
        self._edges = _edges(scene)
        self._plan: list[ReactivePlannerState] = []
        self._age = 0
        self._last = Control(0.0, 0.0)

    def act(self, observation: Observation) -> Control:
        """The next control along the trajectory; hard braking where there is none."""
        self._age += 1
        if not self._plan or self._age >= _REPLAN_STEPS:
            self._plan, self._age = self._planned(observation), 0
        scene = observation.scene
        if self._age + 1 < len(self._plan):
            now, soon = self._plan[self._age], self._plan[self._age + 1]
            accel = (soon.velocity - observation.ego.speed) / scene.dt
            curvature = np.tan(0.5 * (now.steering_angle + soon.steering_angle)) / self._config.vehicle.wheelbase
        else:
            accel, curvature = -min(_BRAKE_M_S2, observation.ego.speed / scene.dt), self._last.curvature
        self._last = Control(
            float(np.clip(accel, -scene.max_accel, scene.max_accel)),
            float(np.clip(curvature, -scene.max_curvature, scene.max_curvature)),
        )
        return self._last

    def _planned(self, observation: Observation) -> list[ReactivePlannerState]:
        ego = observation.ego
        limit = float(observation.scene.route.ahead(float(observation.on_route.along), 1.0).speed_limit[0])
        state = ReactivePlannerState(
            time_step=0,
            position=np.array([ego.x, ego.y]),
            orientation=ego.yaw,
            velocity=ego.speed,
            acceleration=observation.acceleration,
            yaw_rate=ego.speed * self._last.curvature,
            steering_angle=float(np.arctan(self._last.curvature * self._config.vehicle.wheelbase)),
        )
        try:
            self._planner.reset(initial_state_cart=state, collision_checker=self._checker(observation))
            speed = limit if np.isfinite(limit) else _SPEED_M_S
            self._planner.set_desired_velocity(speed, max(ego.speed, _STANDS_M_S))
            planned = self._planner.plan()
        except _NO_PLAN:
            return []
        return [] if planned is None else list(planned[0].state_list)

    def _checker(self, observation: Observation) -> pycrcc.CollisionChecker:
        """Everything that the ego may not touch."""
        checker = pycrcc.CollisionChecker()
        checker.add_collision_object(self._edges)
        for other in observation.others:
            if np.hypot(other.x - observation.ego.x, other.y - observation.ego.y) < _SEEN_M:
                checker.add_collision_object(_expected(other, self._planner.N, self._planner.dt))
        wall = _wall(observation)
        if wall is not None:
            checker.add_collision_object(wall)
        return checker


def _config(scene: Scene) -> ReactivePlannerConfiguration:
    config = ReactivePlannerConfiguration()
    config.debug.logging_level = "ERROR"
    config.debug.multiproc = False
    config.planning.dt = scene.dt
    config.sampling.num_sampling_levels = _LEVELS
    wheelbase = WHEELBASE * scene.ego.length
    # The model of the ego turns about the centre of its box, so the rear axle is there.
    config.vehicle = VehicleConfiguration(
        length=scene.ego.length,
        width=scene.ego.width,
        wb_front_axle=wheelbase,
        wb_rear_axle=0.0,
        a_max=scene.max_accel,
        delta_min=-float(np.arctan(scene.max_curvature * wheelbase)),
        delta_max=float(np.arctan(scene.max_curvature * wheelbase)),
        v_delta_min=-1.0,
        v_delta_max=1.0,
    )
    config.scenario = Scenario(scene.dt)
    config.scenario.add_objects(scene.commonroad())
    return config


def _reference(scene: Scene) -> np.ndarray:
    """The route with straight ends, because the package asks for places before and beyond it."""
    route = scene.route
    along = [*range(-_BEFORE_M, 0), *route.along.tolist(), *(route.length + np.arange(1, _BEYOND_M))]
    return np.array([route.at(float(place))[:2] for place in along])


def _edges(scene: Scene) -> pycrcc.ShapeGroup:
    """The edge of the drivable area as thin boxes."""
    group = pycrcc.ShapeGroup()
    near = shapely.LineString(scene.route.points).buffer(_SEEN_M)
    for line in shapely.get_parts(scene.road.drivable.boundary.intersection(near)):
        points = shapely.get_coordinates(line.simplify(0.05))
        for begin, end in pairwise(points):
            length = float(np.hypot(*(end - begin)))
            if length > 0:
                yaw = float(np.arctan2(*(end - begin)[::-1]))
                group.add_shape(pycrcc.RectOBB(0.5 * length, 0.5 * _KERB_M, yaw, *(0.5 * (begin + end)).tolist()))
    return group


def _expected(other: AgentState, steps: int, dt: float) -> pycrcc.TimeVariantCollisionObject:
    """Where another is expected: straight on at its speed."""
    expected = pycrcc.TimeVariantCollisionObject(0)
    cos, sin = np.cos(other.yaw), np.sin(other.yaw)
    for step in range(steps + 1):
        way = other.speed * dt * step
        x, y = other.x + way * cos, other.y + way * sin
        expected.append_obstacle(pycrcc.RectOBB(0.5 * other.length, 0.5 * other.width, other.yaw, x, y))
    return expected


def _wall(observation: Observation) -> pycrcc.RectOBB | None:
    """A wall at the stop line of the next light that is not green, if the ego can still stop there."""
    light = next((one for one in observation.lights_ahead if one.gap > 0.0), None)
    if light is None or light.shows not in "ryu" or light.gap < observation.ego.speed**2 / (2.0 * _STOPS_M_S2):
        return None
    route, along = observation.scene.route, float(observation.on_route.along)
    x, y, yaw = route.at(along + 0.5 * observation.ego.length + light.gap + _WALL_M)
    return pycrcc.RectOBB(0.5 * _WALL_M, 3.0, yaw, x, y)
