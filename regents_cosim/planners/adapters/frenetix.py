"""TUM's Frenetix (Trauth et al., IEEE Access 2024), at the wheel of an ego.

    git clone https://github.com/TUM-AVS/Frenetix-Motion-Planner    # its folder goes into PYTHONPATH
    pip install frenetix "commonroad-drivability-checker~=2024.1" "numpy<2" pygeos triangle methodtools omegaconf rich \\
        imageio msgspec shapely jaxtyping    # in an environment of its own, with Python 3.11
    --planner python:ENVIRONMENT/bin/python:regents_cosim.planners.adapters.frenetix:Frenetix

Its C++ core samples trajectories along `Scene.route`. It expects the others to go on as they do, and stops at red
lights. Its settings are those of its own files.
"""

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import frenetix_motion_planner  # pyright: ignore[reportMissingImports]
import numpy as np
from commonroad.scenario.scenario import Scenario  # pyright: ignore[reportMissingImports]
from cr_scenario_handler.utils.configuration import (  # pyright: ignore[reportMissingImports]
    FrenetConfiguration,
    SimConfiguration,
)
from cr_scenario_handler.utils.configuration_builder import (  # pyright: ignore[reportMissingImports]
    ConfigurationBuilder,
)
from frenetix_motion_planner.reactive_planner_cpp import ReactivePlannerCpp  # pyright: ignore[reportMissingImports]
from frenetix_motion_planner.state import ReactivePlannerState  # pyright: ignore[reportMissingImports]

from regents_cosim.planners.adapters.commonroad import CommonRoadPlanner
from regents_cosim.planners.interface import MOST_PATHS, MOST_POINTS, Debug, Observation, Scene

_ROOT = str(Path(frenetix_motion_planner.__file__).parents[1])
_MARGINS_M = 0.5, 0.2  # around others, in length and width, and ...
_SPREAD_M2 = 0.1  # ... the variance of where they are expected, both as in its own simulation
_NO_PLAN = (ValueError, RuntimeError)  # where the ego has left the reference path


class Frenetix(CommonRoadPlanner):
    """Asks the package for a trajectory every 0.3 s at 10 Hz, and drives along it."""

    def reset(self, scene: Scene) -> None:
        """Begin a drive: the route becomes the reference path."""
        super().reset(scene)
        logger = logging.getLogger("frenetix")
        logger.setLevel(logging.CRITICAL + 1)
        empty = Scenario(scene.dt)
        empty.add_objects(self.network)
        self._planner = ReactivePlannerCpp(_settings(scene), self._simulation(), empty, None, "", _ROOT, logger)
        self._planner.update_externals(reference_path=self.path())

    def plan(self, observation: Observation) -> list[ReactivePlannerState]:
        """The package's trajectory."""
        scenario, now = self.scenario(observation), self.state(observation)
        state = ReactivePlannerState(
            time_step=0,
            position=now.position,
            orientation=now.orientation,
            velocity=now.velocity,
            acceleration=now.acceleration,
            yaw_rate=now.velocity * self.curvature,
            steering_angle=self.steering_angle,
        )
        self._planner.x_cl = None  # else it takes the ego to be where its last trajectory had it
        self._planner.predictionsForCpp.clear()  # it forgets nobody by itself
        try:
            self._planner.update_externals(
                scenario=scenario,
                x_0=state,
                desired_velocity=self.speed_wanted(observation),
                predictions=dict(self._expected(scenario)),
            )
            planned = self._planner.plan()
        except _NO_PLAN:
            return []
        return [] if planned is None else list(planned[0].state_list)

    def weighed(self) -> Debug:
        """The valid trajectories of the last plan, every few of them, with their costs."""
        sampled = self._planner.all_traj or []
        shown = sampled[:: -(-len(sampled) // MOST_PATHS) or 1]
        feasible, collide = sum(one.feasible for one in sampled), self._planner.infeasible_count_collision
        return Debug(
            candidates=[np.stack([one.cartesian.x, one.cartesian.y], axis=-1)[:MOST_POINTS] for one in shown],
            costs=[float(one.cost) for one in shown],
            text=f"{feasible} of {len(sampled)} trajectories are feasible, {collide} of them collide",
        )

    def _expected(self, scenario: Scenario) -> Iterator[tuple[int, dict[str, Any]]]:
        for other in scenario.obstacles:
            states = [other.state_at_time(step) or other.initial_state for step in range(1, self.horizon_steps + 1)]
            shape = other.obstacle_shape
            yield other.obstacle_id, {
                "pos_list": np.array([state.position for state in states]),
                "orientation_list": np.array([state.orientation for state in states]),
                "v_list": np.array([state.velocity for state in states]),
                "cov_list": np.tile(_SPREAD_M2 * np.eye(2), (len(states), 1, 1)),
                "shape": {"length": shape.length + _MARGINS_M[0], "width": shape.width + _MARGINS_M[1]},
            }

    def _simulation(self) -> SimConfiguration:
        ConfigurationBuilder.set_paths(_ROOT, "configurations", "simulation")
        settings, scene = SimConfiguration(ConfigurationBuilder.construct_configuration("drive")), self.scene
        settings.simulation.use_multiagent, settings.simulation.ego_agent_id = False, 0
        car = settings.vehicle
        car.length, car.width, car.wheelbase, car.a_max = scene.ego.length, scene.ego.width, self.wheelbase, scene.max_accel
        car.wb_front_axle, car.wb_rear_axle = self.wheelbase, 0.0  # the ego turns about the centre of its box
        car.delta_max = float(np.arctan(scene.max_curvature * self.wheelbase))
        car.delta_min = -car.delta_max
        return settings


def _settings(scene: Scene) -> FrenetConfiguration:
    ConfigurationBuilder.set_paths(_ROOT, "configurations", "frenetix_motion_planner")
    settings = FrenetConfiguration(ConfigurationBuilder.construct_configuration("drive"))
    settings.planning.dt = scene.dt
    settings.debug.activate_logging = settings.debug.multiproc = False
    return settings
