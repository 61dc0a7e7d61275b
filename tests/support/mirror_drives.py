"""Drives in the mirror: that of a planner in a case, and tracks as the device has them."""

import jax.numpy as jnp
import numpy as np

from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.world import World, scene_origin
from regents_cosim.planners.under_test import AnyPlanner
from regents_cosim.replays.mirror import MirrorController
from regents_cosim.scenario.scenario import Scenario, Tracks


def replay_in_mirror(scenario: Scenario, planner: AnyPlanner) -> Tracks:
    """The tracks of `scenario`, its ego driven in closed loop by `planner`."""
    with MirrorController(planner) as driver:
        return driver.drive(scenario).tracks


def driven_in(world: World, scenario: Scenario, tracks: Tracks) -> Motion:
    """The motion of `tracks` in the world of `scenario`, as the device computes it."""
    (east, north), extra = scene_origin(scenario), (0, len(world.valid) - len(scenario.agents))
    values = (tracks.x - east, tracks.y - north, np.unwrap(tracks.yaw), tracks.speed)
    return Motion(*(jnp.asarray(np.pad(v, (extra, (0, 0))), jnp.float32) for v in values))
