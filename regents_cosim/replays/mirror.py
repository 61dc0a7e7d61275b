"""A Scenario in the mirror again: the ego driven anew among the case's own background."""

import jax.numpy as jnp
import numpy as np

from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.rollout import drive, with_ego
from regents_cosim.mirror.world import to_tracks, to_world
from regents_cosim.planners.interface import Scene, find_planner, start
from regents_cosim.scenario import Scenario, Tracks


def replay_in_mirror(scenario: Scenario, planner: str | None = None) -> Tracks:
    """The tracks of `scenario`, its ego driven in closed loop by `planner` (None: as in the case)."""
    if planner is None:
        return scenario.tracks
    loop, world = find_planner(planner), to_world(scenario)
    background = Motion(*(jnp.asarray(v) for v in (world.log.x, world.log.y, world.log.yaw, world.log.speed)))
    ego, controls = drive(loop, start(loop, Scene(scenario, world), planner), world, background)
    all_controls = type(controls)(
        *(
            old.at[0].set(new)
            for old, new in zip(
                (world.controls.accel, world.controls.curvature), (controls.accel, controls.curvature), strict=True
            )
        )
    )
    driven = to_tracks(with_ego(background, ego), all_controls, scenario)
    own = np.arange(len(scenario.agents))[:, None] == 0
    return Tracks(
        *(np.where(own, getattr(driven, n), getattr(scenario.tracks, n)) for n in ("x", "y", "yaw", "speed")),
        valid=scenario.tracks.valid,
    )
