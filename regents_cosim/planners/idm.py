"""IDM on a route: it follows its path and keeps its distance to obstacles in its corridor.

The Intelligent Driver Model (Treiber, Hennecke and Helbing 2000) gives the acceleration

    a (1 - (v / v0)^d - (s* / s)^2),   s* = s0 + max(0, v T + v dv / (2 sqrt(a b)))

for every agent whose box reaches into the corridor ahead, and for red lights; the least one counts. Steering is pure
pursuit (Coulter 1992) on the route.
"""

from math import sqrt

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.geometry.boxes import same_level
from regents_cosim.geometry.frames import ahead_and_left, along_and_left
from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.mirror.lookup import look_up
from regents_cosim.mirror.programs.on_device import on_device, seen_from
from regents_cosim.mirror.rollout import Traffic
from regents_cosim.norms.following import LEAST_GAP_M, can_stop, desired_gap
from regents_cosim.norms.limits import ACCEL_LIMIT
from regents_cosim.planners.jax_planner import CompiledScene, JaxPlanner
from regents_cosim.routes.ego_route import SPACING_M
from regents_cosim.routes.route import Route, StopLine, route_into_gaps, route_on
from regents_cosim.scenario.scenario import Scenario

_POINTS = 384  # route points kept, one every metre
_STOP_LINES = 4
_GRID_CELLS = 256  # side of the grid that stores the nearest route point of every cell ...
_GRID_M = 2.0  # ... and the size of its cells: 512 m hold any route of `_POINTS`
_BLOCK_CELLS = 8  # cells along a side of a block ...
_NEAR_M = 36.0  # ... whose cells are computed exactly if its middle is this near: its corners are 11 m from there
_FAR_M = 1e3
_ALREADY_PASSED_M = 1.0  # a stop line this far behind the front bumper no longer holds


class IdmMemory(eqx.Module):
    """The route on the device, and the ego's size."""

    x: Float[Array, " point"]  # [m]
    y: Float[Array, " point"]  # [m]
    cos: Float[Array, " point"]  # direction of the route
    sin: Float[Array, " point"]
    speed: Float[Array, " point"]  # [m/s] desired: within limit and lateral acceleration, with time to brake for both
    nearest: Int[Array, " cell"]  # index of the route point closest to each cell of a square grid
    corner: Float[Array, " 2"]  # [m] corner of that grid
    line: Float[Array, " stop_line"]  # [m] along the route
    closed: Bool[Array, "time stop_line"]  # whether the light is red or yellow
    now: Int[Array, ""]  # the next step
    half_length: Float[Array, ""]  # [m]
    half_width: Float[Array, ""]  # [m]
    z: Float[Array, " point"] | None = None  # [m] heights of the route, in scenes with roads above each other


class IdmSight(eqx.Module):
    """The obstacles along the route."""

    rear: Float[Array, "*time agent"]  # [m] where along the route the agent's box begins
    front: Float[Array, "*time agent"]  # [m] and where it ends
    speed: Float[Array, "*time agent"]  # [m/s] along the route
    blocks: Bool[Array, "*time agent"]  # whether it reaches into the corridor


class IDM(JaxPlanner):
    """IDM with pure pursuit; defaults from Treiber and Kesting 2013, table 11.2 (cars in cities)."""

    time_headway: float = 1.0  # [s]
    standstill_gap: float = 2.0  # [m]
    max_accel: float = 2.0  # [m/s^2]
    comfortable_brake: float = 3.0  # [m/s^2]
    exponent: float = 4.0  # of the free road: greater values keep accelerating longer
    stopping_brake: float = 4.5  # [m/s^2] brakes for a light if this is enough to stop before it
    lateral_accel: float = 3.0  # [m/s^2] limit in curves
    corridor_margin: float = 0.3  # [m] on either side of the ego
    look_ahead: float = 0.5  # [s] of pure pursuit
    min_look_ahead: float = 3.0  # [m]

    def init(self, scene: CompiledScene) -> IdmMemory:
        """The route of the ego (`routes.route`), with lane changes into the gaps that it sees at the first step."""
        memory = self.on_route(scene.scenario, scene.origin, scene.way)
        if scene.world.heights is None:
            return memory
        x, y = memory.x + scene.origin[0], memory.y + scene.origin[1]
        z = scene.scenario.heights.of(0, np.asarray(x, float), np.asarray(y, float))
        return eqx.tree_at(lambda m: m.z, memory, jnp.asarray(z, jnp.float32), is_leaf=lambda leaf: leaf is None)

    def on_route(
        self, scenario: Scenario, origin: Float[np.ndarray, " 2"], way: Float[np.ndarray, "point 2"] | None = None
    ) -> IdmMemory:
        """The memory for the route of a scenario's ego, or for another `way` [m], in coordinates less `origin` [m]."""
        route = route_into_gaps(scenario) if way is None else route_on(scenario, way)
        points = seen_from(_pad_line(route.points), origin)
        direction = np.diff(points, axis=0, append=2.0 * points[-1:] - points[-2:-1])
        angle = np.unwrap(np.arctan2(direction[:, 1], direction[:, 0]))
        nearest, corner = _nearest_points(points)
        line, closed = _stop_lines(route.stop_lines(scenario.signals, scenario.tracks.steps), scenario.tracks.steps)
        return IdmMemory(
            x=on_device(points[:, 0], np.float32),
            y=on_device(points[:, 1], np.float32),
            cos=on_device(np.cos(angle), np.float32),
            sin=on_device(np.sin(angle), np.float32),
            speed=on_device(self._desired_speed(route, angle), np.float32),
            nearest=on_device(nearest, np.int32),
            corner=on_device(corner, np.float32),
            line=line,
            closed=closed,
            now=on_device(0, np.int32),
            half_length=on_device(0.5 * scenario.agents[0].length, np.float32),
            half_width=on_device(0.5 * scenario.agents[0].width, np.float32),
        )

    def look(self, memory: IdmMemory, traffic: Traffic) -> IdmSight:
        """Where along the route every agent's box begins and ends, and whether it blocks the corridor."""
        motion = traffic.motion
        along, across, index = _project(memory, motion.x, motion.y)
        _, _, route_cos, route_sin = _point(memory, index)
        cos, sin = along_and_left(jnp.cos(motion.yaw), jnp.sin(motion.yaw), route_cos, route_sin)
        sin = jnp.abs(sin)
        half_length, half_width = traffic.half_length[:, None], traffic.half_width[:, None]
        reach = jnp.abs(cos) * half_length + sin * half_width
        breadth = sin * half_length + jnp.abs(cos) * half_width
        inside = jnp.abs(across) - breadth < memory.half_width + self.corridor_margin
        if memory.z is not None:
            inside &= same_level(traffic.z, look_up(memory.z, index))
        sight = (along - reach, along + reach, motion.speed * cos, traffic.valid & inside)
        return IdmSight(*(values.T for values in sight))

    def step(self, memory: IdmMemory, sight: IdmSight, ego: Motion) -> tuple[ControlArrays, IdmMemory]:
        """The IDM acceleration for the tightest obstacle, and the pure-pursuit curvature."""
        along, _, index = _project(memory, ego.x, ego.y)
        nose = along + memory.half_length
        ahead = sight.blocks & (0.5 * (sight.rear + sight.front) > along)
        gaps = jnp.where(ahead, sight.rear - nose, _FAR_M)
        to_line = memory.line - nose
        stops = can_stop(ego.speed, to_line, self.stopping_brake)
        held = memory.closed[memory.now] & (to_line > -_ALREADY_PASSED_M) & (stops | (ego.speed < 0.5))
        gaps = jnp.concatenate([gaps, jnp.where(held, to_line + self.standstill_gap - 0.5, _FAR_M)])
        speeds = jnp.concatenate([jnp.where(ahead, sight.speed, ego.speed), jnp.where(held, 0.0, ego.speed)])
        accel = self.accel(ego.speed, look_up(memory.speed, index), gaps, speeds)
        memory = eqx.tree_at(lambda m: m.now, memory, memory.now + 1)
        return ControlArrays(accel, self._curvature(memory, along, ego)), memory

    def accel(self, speed: Array, desired: Array, gaps: Array, speeds: Array) -> Float[Array, ""]:
        """The acceleration [m/s^2] of an ego at `speed` [m/s] that may drive at `desired`.

        `gaps` [m] and `speeds` [m/s] are those of what is ahead on its route, red lights too; all else is far away at
        the ego's speed. A car-following model of another kind replaces this alone.
        """
        # a whole power is a few products
        power = int(self.exponent) if float(self.exponent).is_integer() else self.exponent
        free = 1.0 - (speed / jnp.maximum(desired, 0.1)) ** power
        of_driver = self.time_headway, self.standstill_gap, self.max_accel, self.comfortable_brake
        wanted = desired_gap(jnp, speed, speed - speeds, *of_driver)
        interaction = (wanted / jnp.maximum(gaps, LEAST_GAP_M)) ** 2
        accel = self.max_accel * (jnp.maximum(free, -self.comfortable_brake / self.max_accel) - interaction.max())
        return jnp.clip(accel, -ACCEL_LIMIT, self.max_accel)

    def _curvature(self, memory: IdmMemory, along: Array, ego: Motion) -> Float[Array, ""]:
        ahead = jnp.maximum(self.look_ahead * ego.speed, self.min_look_ahead)
        at = jnp.clip((along + ahead) / SPACING_M, 0.0, _POINTS - 1.001)
        index = at.astype(jnp.int32)
        part = at - index
        (x, y, _, _), (next_x, next_y, _, _) = _point(memory, index), _point(memory, index + 1)
        dx, dy = x * (1.0 - part) + next_x * part - ego.x, y * (1.0 - part) + next_y * part - ego.y
        _, left = ahead_and_left(jnp, dx, dy, ego.yaw)
        return 2.0 * left / jnp.maximum(dx**2 + dy**2, 1.0)

    def _desired_speed(self, route: Route, angle: Float[np.ndarray, " kept"]) -> Float[np.ndarray, " kept"]:
        """Desired speed [m/s] at every point: within the limits, and low enough to brake for later points."""
        window = 5  # points; single kinks of a polyline are no curves
        curvature = np.abs(np.gradient(np.convolve(np.pad(angle, window, "edge"), np.ones(window) / window, "same")))
        bend = np.sqrt(self.lateral_accel / np.maximum(curvature[window:-window] / SPACING_M, 1e-3))
        limit = np.pad(route.speed_limit, (0, max(_POINTS - len(route.speed_limit), 0)), "edge")[:_POINTS]
        speed = np.minimum(limit, bend).tolist()
        for index in range(_POINTS - 2, -1, -1):
            speed[index] = min(speed[index], sqrt(speed[index + 1] ** 2 + 2.0 * self.max_accel * SPACING_M))
        return np.minimum(speed, 60.0)


def place_on_route(memory: IdmMemory, x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Distance along the route and to the left of it [m], and the route's direction there [rad]."""
    along, across, index = _project(memory, x, y)
    _, _, cos, sin = _point(memory, index)
    return along, across, jnp.arctan2(sin, cos)


def route_index(memory: IdmMemory, x: Array, y: Array) -> Int[Array, "*axes"]:
    """The index of the route point that is nearest to each position [m]."""
    return _project(memory, x, y)[2]


def to_stop_lines(memory: IdmMemory, x: Array, y: Array) -> Float[Array, " stop_line"]:
    """The distance [m] of the ego's front to each stop line, with its centre at x, y; negative past the line."""
    along, _, _ = place_on_route(memory, x, y)
    return memory.line - along - memory.half_length


def route_poses(memory: IdmMemory, along: Array) -> tuple[Array, Array, Array, Array]:
    """Positions and directions of the route at distances [m]: x, y [m], cosine, sine; straight on beyond its end."""
    index = jnp.clip(jnp.floor(along / SPACING_M).astype(jnp.int32), 0, _POINTS - 1)
    x, y, cos, sin = _point(memory, index)
    rest = along - index * SPACING_M
    return x + rest * cos, y + rest * sin, cos, sin


def _project(memory: IdmMemory, x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Distance along and across the route [m], left positive, and the index of the nearest point.

    The grid gives a point within a few metres of the nearest, and its tangent gives the rest: the same result as a
    comparison with all points, wherever an agent can reach the corridor.
    """
    cell = jnp.stack([(y - memory.corner[1]) / _GRID_M, (x - memory.corner[0]) / _GRID_M])
    row, column = jnp.clip(jnp.round(cell).astype(jnp.int32), 0, _GRID_CELLS - 1)
    along = _along(memory, look_up(memory.nearest, row * _GRID_CELLS + column), x, y)
    index = jnp.clip(jnp.round(along / SPACING_M).astype(jnp.int32), 0, _POINTS - 1)
    route_x, route_y, cos, sin = _point(memory, index)
    _, left = along_and_left(x - route_x, y - route_y, cos, sin)
    return _along(memory, index, x, y), left, index


def _along(memory: IdmMemory, index: Array, x: Array, y: Array) -> Array:
    route_x, route_y, cos, sin = _point(memory, index)
    return index * SPACING_M + (x - route_x) * cos + (y - route_y) * sin


def _point(memory: IdmMemory, index: Array) -> tuple[Array, ...]:
    """Position and direction of the route at one of its points: x, y [m], cosine, sine."""
    return tuple(look_up(values, index) for values in (memory.x, memory.y, memory.cos, memory.sin))


def _nearest_points(points: Float[np.ndarray, "point 2"]) -> tuple[Int[np.ndarray, " cell"], Float[np.ndarray, " 2"]]:
    """For the cells of a grid around the route the index of the closest point, and the grid's corner [m].

    Cells of a block far from the route share the point closest to the block's middle: no corridor reaches there, and
    this saves nine tenths of the distances. The distances of one block fit into the cache.
    """
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    corner = middle - 0.5 * _GRID_M * (_GRID_CELLS - 1)
    cells = np.arange(_GRID_CELLS, dtype=float)
    blocks = cells.reshape(-1, _BLOCK_CELLS).mean(axis=1)
    east, north = (_squares(corner[axis] + _GRID_M * blocks, points[:, axis]) for axis in (0, 1))
    squares = east + north[:, None]
    nearest = squares.argmin(axis=-1).repeat(_BLOCK_CELLS, axis=0).repeat(_BLOCK_CELLS, axis=1)
    east, north = (_squares(corner[axis] + _GRID_M * cells, points[:, axis]) for axis in (0, 1))
    for row, column in _BLOCK_CELLS * np.argwhere(squares.min(axis=-1) < _NEAR_M**2):
        rows, columns = slice(row, row + _BLOCK_CELLS), slice(column, column + _BLOCK_CELLS)
        nearest[rows, columns] = (north[rows, None] + east[columns]).argmin(axis=-1)
    return nearest.ravel(), corner


def _squares(places: Float[np.ndarray, " place"], points: Float[np.ndarray, " point"]) -> np.ndarray:
    """The squared distance [m^2] of every point from every place, along one axis."""
    return np.square(places[:, None] - points).astype(np.float32)


def _pad_line(points: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "kept 2"]:
    """The first `_POINTS` points, continued straight where there are fewer."""
    missing = _POINTS - len(points)
    if missing <= 0:
        return points[:_POINTS]
    ahead = points[-1] - points[-2]
    return np.concatenate([points, points[-1] + np.arange(1, missing + 1)[:, None] * ahead])


def _stop_lines(
    lights: tuple[StopLine, ...], steps: int
) -> tuple[Float[Array, " stop_line"], Bool[Array, "time stop_line"]]:
    """The first few lights of the route, padded with lines that never close."""
    line, closed = np.full(_STOP_LINES, -_FAR_M), np.zeros((steps, _STOP_LINES), bool)
    for index, light in enumerate(lights[:_STOP_LINES]):
        line[index], closed[:, index] = light.distance_m, light.stop
    return on_device(line, np.float32), on_device(closed, np.bool_)
