"""Moves the other road users of a scenario around a given drive of the ego, to which they react."""

import jax
import numpy as np
from jaxtyping import Array, Bool, Float

from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.programs.jax_settings import in_float32
from regents_cosim.mirror.programs.on_device import on_device
from regents_cosim.mirror.rollout import EgoTrack, FixedEgo, drive_among_reacting
from regents_cosim.mirror.world import World, scene_origin, to_roadless_world, to_tracks
from regents_cosim.scenario.scenario import VEHICLE_KINDS, Scenario, Tracks, with_rows

Poses = tuple[Float[np.ndarray, " time"], ...]  # x, y [m], yaw [rad], speed [m/s]


@in_float32
def among_reacting(scenario: Scenario, ego: Poses, reacting: Bool[np.ndarray, " agent"]) -> Tracks:
    """The tracks of the scenario where the `reacting` agents follow, give way and drive around, as in an attack.

    The ego drives as given, and is an obstacle where that is not its track. All others keep to their tracks.
    """
    world = to_roadless_world(scenario).for_reactions(scenario)
    x, y = scene_origin(scenario)
    ego_x, ego_y, yaw, speed = ego
    motion = Motion(*(on_device(values, np.float32) for values in (ego_x - x, ego_y - y, np.unwrap(yaw), speed)))
    moved = _react(world.without_road(), motion, padded_to(world, reacting))
    return with_rows(scenario.tracks, to_tracks(moved, world.controls, scenario), reacting)


def those_who_react(scenario: Scenario) -> Bool[np.ndarray, " agent"]:
    """The agents that react to others: vehicles that no attack moves."""
    return np.array([agent.role == "background" and agent.kind in VEHICLE_KINDS for agent in scenario.agents])


def padded_to(world: World, chosen: Bool[np.ndarray, " agent"]) -> Bool[Array, " padded"]:
    """The chosen agents on the device, with the padding of the world."""
    return on_device(np.pad(chosen, (0, len(world.vehicle) - len(chosen))), np.bool_)


@compiled
def _react(world: World, ego: Motion, reacting: Bool[Array, " agent"]) -> Motion:
    track = EgoTrack(ego, jax.tree.map(lambda values: values[0], world.controls))
    return drive_among_reacting(FixedEgo(), track, world, world.log, reacting)[0]
