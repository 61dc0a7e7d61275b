"""The Intelligent Driver Model of `commonroad-idm-planner`, at the wheel of an ego.

    pip install commonroad-idm-planner numpy msgspec shapely jaxtyping    # in an environment of its own
    --planner python:ENVIRONMENT/bin/python:regents_cosim.planners.adapters.idm:IdmPlanner

It plans a speed along `Scene.route`, with the settings of Treiber, Hennecke and Helbing 2000 that are its own.
"""

import logging
from collections.abc import Sequence

import numpy as np
from commonroad_idm_planner.configuration.planner_config import (  # pyright: ignore[reportMissingImports]
    IDMConfig,
    IDMConfigFactory,
)
from commonroad_idm_planner.idm_path import IDMPath, IDMPathFactory  # pyright: ignore[reportMissingImports]
from commonroad_idm_planner.idm_planner import IDMPlanner as Package  # pyright: ignore[reportMissingImports]
from commonroad_idm_planner.idm_state import IDMState  # pyright: ignore[reportMissingImports]

from regents_cosim.planners.adapters.commonroad import CommonRoadPlanner
from regents_cosim.planners.interface import Observation, Scene

_AHEAD_M, _SPACING_M = 100.0, 1.0


class IdmPlanner(CommonRoadPlanner):
    """Asks the package for a speed profile every 0.3 s at 10 Hz."""

    horizon_steps = 11  # the package looks 10 steps ahead

    def reset(self, scene: Scene) -> None:
        """Begin a drive."""
        super().reset(scene)
        logging.getLogger("cr_idm.idm_planner").setLevel(logging.ERROR)
        self._package: Package | None = None

    def plan(self, observation: Observation) -> Sequence[IDMState]:
        """The package's trajectory along the next 100 m of the route."""
        config = IDMConfigFactory.generate_default_config(ignore_static_obstacles=False)
        config.v_desired = self.speed_wanted(observation)
        config.vehicle_length, config.vehicle_width = self.scene.ego.length, self.scene.ego.width
        here, route = float(observation.on_route.along), self.scene.route
        ahead = np.array([route.at(here + way)[:2] for way in np.arange(0.0, _AHEAD_M, _SPACING_M)])
        path = IDMPathFactory.generate_idm_path_from_np_2d_positional_array(ahead)
        with np.errstate(all="ignore"):  # its speeds fall without bound where no gap is left
            return self._asked(config, path, observation)

    def _asked(self, config: IDMConfig, path: IDMPath, observation: Observation) -> Sequence[IDMState]:
        scenario, problem = self.scenario(observation), self.problem(observation)
        if self._package is None:
            self._package = package = Package(scenario, problem, config, path, logging.ERROR)
            return package.plan().state_list
        self._package.update_config(config)
        self._package._scenario = scenario  # its own way also makes a checker of collisions, which no plan asks
        return self._package.re_plan(problem, path).state_list
