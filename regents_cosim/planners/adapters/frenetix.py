r"""TUM's Frenetix 2024.4 (Trauth et al., IEEE Access 2024), at the wheel of an ego.

    git clone https://github.com/TUM-AVS/Frenetix-Motion-Planner    # and have its folder in PYTHONPATH
    pip install frenetix "commonroad-drivability-checker~=2024.1" "commonroad-io~=2024.2" commonroad-vehicle-models \
        "numpy<2" pygeos triangle methodtools omegaconf imageio rich msgspec shapely jaxtyping
    --planner python:ENVIRONMENT/bin/python:regents_cosim.planners.adapters.frenetix:Frenetix

It needs an environment of its own. It follows `Scene.route` at the speed limit with the settings of its files, expects
the others to go on as they do, and stops at red lights.
"""

import logging
from functools import cache
from pathlib import Path
from typing import Any

import frenetix_motion_planner  # pyright: ignore[reportMissingImports]
import numpy as np
from commonroad.scenario.scenario import Scenario  # pyright: ignore[reportMissingImports]
from commonroad_dc import pycrcc  # pyright: ignore[reportMissingImports]
from cr_scenario_handler.utils import configuration  # pyright: ignore[reportMissingImports]
from cr_scenario_handler.utils.configuration_builder import (  # pyright: ignore[reportMissingImports]
    ConfigurationBuilder,
)
from frenetix_motion_planner.reactive_planner_cpp import ReactivePlannerCpp  # pyright: ignore[reportMissingImports]
from frenetix_motion_planner.state import ReactivePlannerState  # pyright: ignore[reportMissingImports]

from regents_cosim.planners.adapters.commonroad import CommonRoadPlanner, candidates
from regents_cosim.planners.interface import Debug, Observation, Scene

_CLONE = str(Path(frenetix_motion_planner.__path__[0]).parent)  # its settings are not part of the package
_LONGER_M, _WIDER_M = 0.5, 0.2  # others are expected larger by this, and ...
_SPREAD_M2 = 0.1  # ... with this variance, both as in its own simulation
_NO_PLAN = (ValueError, RuntimeError)  # where the ego has left the reference path, or drives along it backwards


class _QuickPlanner(ReactivePlannerCpp):
    """The package's planner, which asks its slow check only about trajectories that touch nothing at any step."""

    def trajectory_collision_check(self, feasible_trajectories: list[Any]) -> Any:
        """The first trajectory that the package's check passes, or none."""
        checker, car = pycrcc.CollisionChecker(), self.vehicle_params
        checker.add_collision_object(self.road_boundary)
        for other in self.predictions.values():
            (x, y), shape = other["pos_list"].T, other["shape"]
            checker.add_collision_object(_boxes(1, x, y, other["orientation_list"], shape["length"], shape["width"]))
        for one in feasible_trajectories:
            way = one.cartesian
            if checker.collide(_boxes(0, way.x, way.y, way.theta, car.length, car.width)):
                self._collision_counter += 1
            elif super().trajectory_collision_check([one]) is not None:
                return one
        return None


class Frenetix(CommonRoadPlanner):
    """Asks the package for a trajectory every 0.3 s at 10 Hz, and drives along it."""

    def reset(self, scene: Scene) -> None:
        """Begin a drive: the route becomes the reference path."""
        super().reset(scene)
        logger, road = logging.getLogger("frenetix"), Scenario(scene.dt)
        logger.setLevel(logging.CRITICAL + 1)
        road.add_objects(self.network)
        settings = configuration.FrenetConfiguration(_settings("frenetix_motion_planner"))
        settings.planning.dt, settings.debug.activate_logging, settings.debug.multiproc = scene.dt, False, False
        self._planner = _QuickPlanner(settings, self._simulation(), road, None, "", _CLONE, logger)
        self._planner.update_externals(reference_path=self.path())

    def plan(self, observation: Observation) -> list[ReactivePlannerState]:
        """The package's trajectory."""
        scenario = self.scenario(observation)
        self._planner.x_cl = None  # else it takes the ego to be where its last trajectory had it
        self._planner.predictionsForCpp.clear()  # else it keeps those that have left
        try:
            self._planner.update_externals(
                scenario=scenario,
                x_0=self.state_as(ReactivePlannerState, observation),
                desired_velocity=self.speed_wanted(observation),
                predictions={one.obstacle_id: self._expected(one) for one in scenario.obstacles},
            )
            planned = self._planner.plan()
        except _NO_PLAN:
            return []
        return [] if planned is None else list(planned[0].state_list)

    def weighed(self) -> Debug:
        """The trajectories of the last plan, every few of them, with their costs."""
        sampled, collide = self._planner.all_traj or [], self._planner.infeasible_count_collision
        feasible = sum(one.feasible for one in sampled)
        return candidates(sampled, f"{feasible} of {len(sampled)} trajectories are feasible, {collide} of them collide")

    def _expected(self, other: Any) -> dict[str, Any]:
        """From the next step on, as in its own simulation."""
        states = [other.state_at_time(step) for step in range(1, self.horizon_steps + 1)]
        shape = other.obstacle_shape
        return {
            "pos_list": np.array([state.position for state in states]),
            "orientation_list": np.array([state.orientation for state in states]),
            "v_list": np.array([state.velocity for state in states]),
            "cov_list": np.tile(_SPREAD_M2 * np.eye(2), (len(states), 1, 1)),
            "shape": {"length": shape.length + _LONGER_M, "width": shape.width + _WIDER_M},
        }

    def _simulation(self) -> configuration.SimConfiguration:
        settings, scene = configuration.SimConfiguration(_settings("simulation")), self.scene
        settings.simulation.use_multiagent, settings.simulation.ego_agent_id = False, 0
        car, most = settings.vehicle, float(np.arctan(scene.max_curvature * self.wheelbase))
        car.length, car.width, car.a_max = scene.ego.length, scene.ego.width, scene.max_accel
        car.wheelbase, car.wb_rear_axle = self.wheelbase, 0.0  # the ego turns about the centre of its box
        car.delta_min, car.delta_max = -most, most
        return settings


def _boxes(begin: int, x: Any, y: Any, yaw: Any, length: float, width: float) -> pycrcc.TimeVariantCollisionObject:
    boxes = pycrcc.TimeVariantCollisionObject(begin)
    for place in zip(yaw, x, y, strict=True):
        boxes.append_obstacle(pycrcc.RectOBB(0.5 * length, 0.5 * width, *place))
    return boxes


@cache
def _settings(folder: str) -> Any:
    ConfigurationBuilder.set_paths(_CLONE, "configurations", folder)
    return ConfigurationBuilder.construct_configuration("drive")
