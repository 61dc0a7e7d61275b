"""What adapters tell their planners of a scene, whatever their types are."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from regents_cosim.geometry.frames import Pose
from regents_cosim.norms.following import can_stop
from regents_cosim.planners.interface import AgentState, LightAhead, Observation

WALL_M = 0.5  # thickness of the wall that stands at a red light
_SEEN_M = 80.0
_STOPS_M_S2 = 4.0  # a light that needs harder braking is passed


def near(observation: Observation) -> Iterator[AgentState]:
    """The others within 80 m of the ego."""
    ego = observation.ego
    return (other for other in observation.others if np.hypot(other.x - ego.x, other.y - ego.y) < _SEEN_M)


def nearest(observation: Observation, most: int) -> list[AgentState]:
    """At most so many others near the ego, the nearest first."""
    ego = observation.ego
    return sorted(near(observation), key=lambda other: np.hypot(other.x - ego.x, other.y - ego.y))[:most]


def straight_on(other: AgentState, seconds: float) -> Float[np.ndarray, "2 2"]:
    """The path [m] of a road user that goes on as it does."""
    ahead = other.speed * seconds * np.array([np.cos(other.yaw), np.sin(other.yaw)])
    return np.array([other.x, other.y]) + np.stack([np.zeros(2), ahead])


def red_light(observation: Observation) -> LightAhead | None:
    """The next light, if it is not green and the ego can still stop there."""
    light = next((one for one in observation.lights_ahead if one.gap > 0.0), None)
    held = light is not None and light.shows in "ryu" and can_stop(observation.ego.speed, light.gap, _STOPS_M_S2)
    return light if held else None


def wall_at_red(observation: Observation) -> Pose | None:
    """Where a wall keeps the ego from passing a red light."""
    light = red_light(observation)
    front = float(observation.on_route.along) + 0.5 * observation.ego.length
    return None if light is None else observation.scene.route.at(front + light.gap + WALL_M)
