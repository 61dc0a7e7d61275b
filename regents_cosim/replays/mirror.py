"""A Scenario in the mirror again: the ego driven anew among the case's own background."""

from dataclasses import replace

import equinox as eqx
import jax
import numpy as np

from regents_cosim.mirror.rollout import drive, with_ego
from regents_cosim.mirror.world import to_tracks, to_world
from regents_cosim.planners.interface import Scene, find_planner, start
from regents_cosim.scenario import Scenario, Tracks

_drive = eqx.filter_jit(drive)


def replay_in_mirror(scenario: Scenario, planner: str | None = None) -> Tracks:
    """The tracks of `scenario`, its ego driven in closed loop by `planner` (None: as in the case).

    Raises PlannerError where the planner cannot be found or fails.
    """
    if planner is None:
        return scenario.tracks
    loop, world = find_planner(planner), to_world(scenario)
    ego, ego_controls = _drive(loop, start(loop, Scene(scenario, world), planner), world, world.log)
    controls = jax.tree.map(lambda all_, own: all_.at[0].set(own), world.controls, ego_controls)
    driven = to_tracks(with_ego(world.log, ego), controls, scenario)
    is_ego = np.arange(len(scenario.agents))[:, None] == 0
    changed = {
        name: np.where(is_ego, getattr(driven, name), getattr(scenario.tracks, name))
        for name in ("x", "y", "yaw", "speed")
    }
    return replace(scenario.tracks, **changed, accel=None, curvature=None)
