"""The ego's own way: where it is to go next, and the lights on it.

Weights that follow the route are shown a point of the route some way ahead in place of the log's end: that end tells
where the log waited, so that lights need not be looked at. Of the lights they are shown those of the ego's own way
alone, as thick bars: a picture of all of them does not say which one holds for the ego, and where several ways on begin
at one lane their bars are a few pixels wide. They are also told how near the next closed one is, as a number.
"""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt8

from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.compiled import compiled
from regents_cosim.mirror.ground import AMBER, DARK, GREEN, RED
from regents_cosim.mirror.on_device import on_device
from regents_cosim.mirror.separation import Box
from regents_cosim.planners.idm import IDM, IdmMemory, place_on_route, route_poses, to_stop_lines
from regents_cosim.routes.ego_route import StopLine, plan_route
from regents_cosim.scenario import Scenario, Signal

AHEAD_M = 20.0  # how far ahead on the route the target is: as far as the view reaches
OVER_M = 1.0  # so far past a closed light's line it still holds
_LIGHT_M = 40.0  # how far ahead a closed light is told of: as far as bars are drawn, and a little further
_BARS = 4  # lights of a route that are known
_HALF_THICK_M, _HALF_WIDE_M = 1.0, 1.4  # of their bars, which end at the stop line


class OwnWay(eqx.Module):
    """The route of an ego, and its lights."""

    route: IdmMemory
    bars: Box  # [bar]
    lights: UInt8[Array, "*time bar"]

    @classmethod
    def of(cls, scenario: Scenario, origin: Float[np.ndarray, " 2"]) -> "OwnWay":
        """In the coordinates of the map less `origin` [m]."""
        route = IDM().on_route(scenario, origin)
        lines = plan_route(scenario).stop_lines[:_BARS]
        along = np.full(_BARS, -1.0)
        along[: len(lines)] = [line.distance_m for line in lines]
        x, y, cos, sin = _poses(route, on_device(along - _HALF_THICK_M, np.float32))
        halves = (on_device(np.full(_BARS, half), np.float32) for half in (_HALF_THICK_M, _HALF_WIDE_M))
        lights = np.full((scenario.tracks.steps, _BARS), DARK, np.uint8)
        for index, line in enumerate(lines):
            lights[:, index] = _shown(line)
        return cls(route, Box(x, y, cos, sin, *halves), on_device(lights, np.uint8))

    def target(self, ego: Motion) -> Float[Array, " 2"]:
        """The point of the route ahead of the ego [m]."""
        along, _, _ = place_on_route(self.route, ego.x, ego.y)
        x, y, _, _ = route_poses(self.route, along + AHEAD_M)
        return jnp.stack([x, y])

    def light(self, ego: Motion, now: Int[Array, ""]) -> Float[Array, ""]:
        """How near the front of the ego is to the next closed light: 1 at its line, falling to 0 at 40 m; else 0."""
        gap = to_stop_lines(self.route, ego.x, ego.y)
        near = jnp.clip(1.0 - gap / _LIGHT_M, 0.0, 1.0)
        return jnp.where(self.route.closed[now] & (gap > -OVER_M), near, 0.0).max()


@compiled
def _poses(route: IdmMemory, along: Float[Array, " bar"]) -> tuple[Array, Array, Array, Array]:
    return route_poses(route, along)


def _shown(line: StopLine) -> UInt8[np.ndarray, " time"]:
    return np.where(line.red, RED, np.where(line.stop, AMBER, GREEN)).astype(np.uint8)


def relit(scenario: Scenario) -> tuple[Scenario, ...]:
    """The same with all lights red, and with all of them green; nothing where no light is on the ego's route.

    Lessons for drivers that know the lights (`teacher`): what the others do tells nothing about them any more.
    """
    if not plan_route(scenario).stop_lines:
        return ()

    def all_of(letter: str) -> tuple[Signal, ...]:
        return tuple(Signal(light.id, ((0, letter * len(light.letters(0))),)) for light in scenario.signals)

    return tuple(replace(scenario, signals=all_of(letter)) for letter in "rG")


def together(ways: list[OwnWay]) -> OwnWay:
    """All of them in one, by scene."""
    return jax.tree.map(lambda *values: jnp.stack(values), *ways)
