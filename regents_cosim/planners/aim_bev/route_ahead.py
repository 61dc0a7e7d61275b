"""The route ahead of the ego as AIM-BEV sees it: its next target, and the lights on it.

Weights that follow the route get a point of the route ahead as target instead of the log's end: the end tells where the
log waited, so that a network would not need to look at lights. They see only the lights of the ego's own way, as thick
bars: a picture of all lights does not tell which one applies to the ego, and where several ways begin at one lane the
bars are a few pixels wide. They also get the nearness of the next closed light as a number.
"""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt8

from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.programs.on_device import on_device
from regents_cosim.mirror.separation import Box
from regents_cosim.planners.aim_bev.ground import AMBER, DARK, GREEN, RED
from regents_cosim.planners.idm import IDM, IdmMemory, place_on_route, route_poses, to_stop_lines
from regents_cosim.routes.route import route_into_gaps
from regents_cosim.scenario.scenario import Scenario, Signal

AHEAD_M = 20.0  # distance of the target along the route: as far as the view reaches
OVER_M = 1.0  # a closed light holds up to this far past its line
_LIGHT_M = 40.0  # from this distance on a closed light is reported: a little beyond the drawn bars
_BARS = 4  # lights of a route that are considered
_HALF_THICK_M, _HALF_WIDE_M = 1.0, 1.4  # of the bars, which end at the stop line


class RouteAhead(eqx.Module):
    """The route of an ego, and its lights."""

    route: IdmMemory
    bars: Box  # [bar]
    lights: UInt8[Array, "*time bar"]

    @classmethod
    def of(cls, scenario: Scenario, origin: Float[np.ndarray, " 2"]) -> "RouteAhead":
        """The route of a scenario's ego, in the coordinates of the map less `origin` [m]."""
        route = IDM().on_route(scenario, origin)
        lines = route_into_gaps(scenario).stop_lines(scenario.signals, scenario.tracks.steps)[:_BARS]
        along = np.full(_BARS, -1.0)
        along[: len(lines)] = [line.distance_m for line in lines]
        x, y, cos, sin = _poses(route, on_device(along - _HALF_THICK_M, np.float32))
        halves = (on_device(np.full(_BARS, half), np.float32) for half in (_HALF_THICK_M, _HALF_WIDE_M))
        lights = np.full((scenario.tracks.steps, _BARS), DARK, np.uint8)
        for index, line in enumerate(lines):
            lights[:, index] = np.where(line.red, RED, np.where(line.stop, AMBER, GREEN))
        return cls(route, Box(x, y, cos, sin, *halves), on_device(lights, np.uint8))

    def target(self, ego: Motion) -> Float[Array, " 2"]:
        """The point of the route ahead of the ego [m]."""
        along, _, _ = place_on_route(self.route, ego.x, ego.y)
        x, y, _, _ = route_poses(self.route, along + AHEAD_M)
        return jnp.stack([x, y])

    def light(self, ego: Motion, now: Int[Array, ""]) -> Float[Array, ""]:
        """Nearness of the next closed light to the ego's front: 1 at its line, falling to 0 at 40 m; 0 without one."""
        gap = to_stop_lines(self.route, ego.x, ego.y)
        near = jnp.clip(1.0 - gap / _LIGHT_M, 0.0, 1.0)
        return jnp.where(self.route.closed[now] & (gap > -OVER_M), near, 0.0).max()


_poses = compiled(route_poses)


def all_red_and_all_green(scenario: Scenario) -> tuple[Scenario, ...]:
    """The scenario with all lights red, and with all lights green; nothing where no light is on the ego's route.

    These are lessons from drivers that know the lights (`teacher`), as the others no longer behave by them.
    """
    if not route_into_gaps(scenario).stop_lines(scenario.signals, 1):
        return ()

    def all_of(letter: str) -> tuple[Signal, ...]:
        return tuple(Signal(light.id, ((0, letter * len(light.letters(0))),)) for light in scenario.signals)

    return tuple(replace(scenario, signals=all_of(letter)) for letter in "rG")


def stack_routes(routes: list[RouteAhead]) -> RouteAhead:
    """Stack several routes by scene."""
    return jax.tree.map(lambda *values: jnp.stack(values), *routes)
