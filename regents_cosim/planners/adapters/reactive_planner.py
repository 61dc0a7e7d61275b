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

from regents_cosim.planners.adapters.commonroad import BEFORE_M, CommonRoadPlanner, candidates
from regents_cosim.planners.adapters.seen import WALL_M, near, wall_at_red
from regents_cosim.planners.interface import AgentState, Debug, Observation, Scene

_LEVELS = 3  # of the density of samples; one more takes seconds where nothing is feasible
_STANDS_M_S = 0.01  # at 0 the package looks for a planning problem
_EDGES_M = 80.0  # beside the route
_KERB_M = 0.1  # width of the edge of the road
_MOST_RAD = 2.0 * np.pi - 0.01  # the package refuses reference paths whose heading goes further, as in roundabouts
_RENEWED_M = 60.0  # before its end a reference path that was cut is replaced

# What the package raises where the ego has left the reference path, and where it stands and cannot move: then it fails
# to print a cost that it does not have (TypeError).
_NO_PLAN = (ValueError, CartesianProjectionDomainError, CurvilinearProjectionDomainLateralError, TypeError)


class _RememberingPlanner(Package):
    """The package's planner, which keeps what it sampled last."""

    sampled = None

    def _create_trajectory_bundle(self, *args, **kwargs):
        self.sampled = super()._create_trajectory_bundle(*args, **kwargs)
        return self.sampled


class ReactivePlanner(CommonRoadPlanner):
    """Asks the package for a trajectory every 0.3 s at 10 Hz, and drives along it."""

    def reset(self, scene: Scene) -> None:
        """Begin a drive: the route becomes the reference path."""
        super().reset(scene)
        logging.getLogger("RP_LOGGER").setLevel(logging.ERROR)
        self._planner = _RememberingPlanner(self._config())
        self._path, self._until_m = self.path(), 0.0
        self._follow(0.0)
        self._edges = _edges(scene)

    def plan(self, observation: Observation) -> list[ReactivePlannerState]:
        """The package's trajectory."""
        state = self.state_as(ReactivePlannerState, observation)
        self._follow(float(observation.on_route.along))
        try:
            self._planner.reset(initial_state_cart=state, collision_checker=self._checker(observation))
            self._planner.set_desired_velocity(self.speed_wanted(observation), max(state.velocity, _STANDS_M_S))
            planned = self._planner.plan()
        except _NO_PLAN:
            return []
        return [] if planned is None else list(planned[0].state_list)

    def weighed(self) -> Debug:
        """The feasible trajectories of the last plan, every few of them, with their costs."""
        sampled = self._planner.sampled
        feasible = [] if sampled is None else [one for one in sampled.trajectories if one.cartesian is not None]
        collide = self._planner.infeasible_count_collision
        return candidates(feasible, f"{len(feasible)} feasible trajectories, {collide} of them collide")

    def _follow(self, along_m: float) -> None:
        """Make the route ahead the reference path, unless the present one still reaches far enough."""
        if along_m + _RENEWED_M < self._until_m:
            return
        ahead = self._path[max(int(along_m), 0) :]  # from `BEFORE_M` behind, a point every metre
        far = np.abs(np.unwrap(np.arctan2(*np.diff(ahead, axis=0).T[::-1]))) > _MOST_RAD
        kept = int(np.argmax(far)) if far.any() else len(ahead)
        self._until_m = along_m + kept - BEFORE_M if far.any() else np.inf
        path = CoordinateSystem(ahead[:kept], clcs_params=CLCSParams())
        self._planner.set_reference_path(coordinate_system=path)

    def _checker(self, observation: Observation) -> pycrcc.CollisionChecker:
        """What the package's own checker of a scenario has, made without the scenario, many times faster."""
        checker = pycrcc.CollisionChecker()
        checker.add_collision_object(self._edges)
        for other in near(observation):
            checker.add_collision_object(_expected(other, self._planner.N, self._planner.dt))
        wall = wall_at_red(observation)
        if wall is not None:
            x, y, yaw = (float(value) for value in wall)
            checker.add_collision_object(pycrcc.RectOBB(0.5 * WALL_M, 3.0, yaw, x, y))
        return checker

    def _config(self) -> ReactivePlannerConfiguration:
        config, scene = ReactivePlannerConfiguration(), self.scene
        config.debug.logging_level = "ERROR"
        config.debug.multiproc = False
        config.planning.dt = scene.dt
        config.sampling.num_sampling_levels = _LEVELS
        most = float(np.arctan(scene.max_curvature * self.wheelbase))
        # The model of the ego turns about the centre of its box, so the rear axle is there.
        config.vehicle = VehicleConfiguration(
            length=scene.ego.length,
            width=scene.ego.width,
            wb_front_axle=self.wheelbase,
            wb_rear_axle=0.0,
            a_max=scene.max_accel,
            delta_min=-most,
            delta_max=most,
            v_delta_min=-1.0,
            v_delta_max=1.0,
        )
        config.scenario = Scenario(scene.dt)
        config.scenario.add_objects(self.network)
        return config


def _edges(scene: Scene) -> pycrcc.ShapeGroup:
    """The edge of the drivable area as thin boxes."""
    group = pycrcc.ShapeGroup()
    beside = shapely.LineString(scene.route.points).buffer(_EDGES_M)
    for line in shapely.get_parts(scene.road.drivable.boundary.intersection(beside)):
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
