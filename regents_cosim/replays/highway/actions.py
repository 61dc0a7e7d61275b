"""Computes actions with which highway-env's vehicles follow a scenario's tracks."""

import numpy as np
from jaxtyping import Bool, Float

from regents_cosim.geometry.frames import wrap
from regents_cosim.mirror.jax_settings import in_float32
from regents_cosim.scenario import Scenario

_FOLLOWS_M = 1e-3  # tracks that the exact inverse misses by more come from another model
_MIN_TRAVEL_M = 1e-6


@in_float32
def actions(scenario: Scenario) -> Float[np.ndarray, "2 agent step"]:
    """Accelerations [m/s^2] and curvatures [1/m] of all agents, 0 while absent.

    Tracks made by highway-env or by its twin are inverted exactly; others are fitted with the twin in the mirror.
    """
    found = _inverse(scenario)
    off = _missed(scenario, found)
    if off.any():
        from regents_cosim.mirror.world import to_roadless_world  # JAX is needed for fits only

        controls, agents = to_roadless_world(scenario, "highway").controls, len(scenario.agents)
        fitted = np.stack([np.asarray(v, float)[:agents] for v in (controls.accel, controls.curvature)])
        found[:, off] = fitted[:, off]
    return found


def _inverse(scenario: Scenario) -> Float[np.ndarray, "2 agent step"]:
    tracks, dt = scenario.tracks, scenario.dt
    held = tracks.valid[:, :-1] & tracks.valid[:, 1:]
    travelled = tracks.speed[:, :-1] * dt
    turned = np.asarray(wrap(np.diff(tracks.yaw, axis=1)))
    curvature = np.where(travelled > _MIN_TRAVEL_M, turned / np.maximum(travelled, _MIN_TRAVEL_M), 0.0)
    return np.where(held, np.stack([np.diff(tracks.speed, axis=1) / dt, curvature]), 0.0)


def _missed(scenario: Scenario, found: Float[np.ndarray, "2 agent step"]) -> Bool[np.ndarray, " agent"]:
    """Whether highway-env's model would leave each agent's track."""
    tracks = scenario.tracks
    held = tracks.valid[:, :-1] & tracks.valid[:, 1:]
    sine = 0.5 * np.array([agent.length for agent in scenario.agents])[:, None] * found[1]
    course = tracks.yaw[:, :-1] + np.arcsin(np.clip(sine, -1.0, 1.0))
    went = np.where(held, tracks.speed[:, :-1] * scenario.dt * np.exp(1j * course), 0.0)
    should = np.where(held, np.diff(tracks.x + 1j * tracks.y, axis=1), 0.0)
    return (np.abs(np.cumsum(went - should, axis=1)).max(axis=1) > _FOLLOWS_M) | (np.abs(sine) > 1.0).any(axis=1)
