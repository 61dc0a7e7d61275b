"""The Intelligent Driver Model of `commonroad-idm-planner`, at the wheel of an ego.

    pip install commonroad-idm-planner numpy msgspec shapely jaxtyping    # in an environment of its own
    --planner python:ENVIRONMENT/bin/python:regents_cosim.planners.adapters.idm:IdmPlanner

It plans a speed along `Scene.route`, with the settings of Treiber, Hennecke and Helbing 2000 that are its own.
"""

import logging
from collections.abc import Sequence

import numpy as np
from commonroad_idm_planner.configuration.planner_config import (  # pyright: ignore[reportMissingImports]
    IDMConfigFactory,
)
from commonroad_idm_planner.idm_path import IDMPathFactory  # pyright: ignore[reportMissingImports]
from commonroad_idm_planner.idm_planner import IDMPlanner as Package  # pyright: ignore[reportMissingImports]
from commonroad_idm_planner.idm_state import IDMState  # pyright: ignore[reportMissingImports]

from regents_cosim.planners.adapters.commonroad import CommonRoadPlanner
from regents_cosim.planners.interface import Observation

_AHEAD_M, _SPACING_M = 100.0, 0.5


class IdmPlanner(CommonRoadPlanner):
    """Asks the package for a speed profile every 0.3 s at 10 Hz."""

    def plan(self, observation: Observation) -> Sequence[IDMState]:
        """The package's trajectory along the next 100 m of the route."""
        logging.getLogger("cr_idm.idm_planner").setLevel(logging.ERROR)
        config = IDMConfigFactory.generate_default_config(ignore_static_obstacles=False)
        config.v_desired = self.speed_wanted(observation)
        config.vehicle_length, config.vehicle_width = self.scene.ego.length, self.scene.ego.width
        here, route = float(observation.on_route.along), self.scene.route
        ahead = np.array([route.at(here + way)[:2] for way in np.arange(0.0, _AHEAD_M, _SPACING_M)])
        path = IDMPathFactory.generate_idm_path_from_np_2d_positional_array(ahead)
        package = Package(self.scenario(observation), self.problem(observation), config, path, logging.ERROR)
        return package.plan().state_list
