"""Recorded traffic as lessons: any vehicle of any window at any step, with its view and the expert's waypoints.

All data lies on the device once; views are rendered on demand, which costs less than reading them from disk and allows
other perturbations in every pass.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt8

from regents_cosim.errors import RegentsError, require
from regents_cosim.geometry.frames import ahead_and_left
from regents_cosim.geometry.lines import distances_along
from regents_cosim.geometry.rasters import MOST_CELLS
from regents_cosim.mirror.actions import fill_gaps
from regents_cosim.mirror.bicycle import ControlArrays, Motion, clip, step
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.separation import Box
from regents_cosim.planners.aim_bev.architecture import WAYPOINTS
from regents_cosim.planners.aim_bev.camera import Camera
from regents_cosim.planners.aim_bev.ground import Ground, draw_cells, stop_bars
from regents_cosim.planners.aim_bev.network_inputs import AS_IN_THE_PAPERS, NetworkInputs
from regents_cosim.planners.aim_bev.observe import Surroundings, observe
from regents_cosim.planners.aim_bev.route_ahead import RouteAhead, stack_routes
from regents_cosim.scenario.scenario import Scenario

_BEYOND_M = 20.0  # margin around the tracks within which the whole view is drawn
_MOST_INDEX = 2**31 - 1  # the greatest index of 32 bits


class Lesson(eqx.Module):
    """A lesson: who is taught, when, and in which state, the log's or one away from it."""

    scene: Int[Array, "*axes"]
    agent: Int[Array, "*axes"]
    step: Int[Array, "*axes"]
    goal: Float[Array, "*axes 2"]  # [m, map frame]
    state: Motion  # [m, map frame]


class Classroom(eqx.Module):
    """All windows, padded to the same number of agents and stop bars, in the coordinates of their maps."""

    log: Motion  # [scene agent time]
    valid: Bool[Array, "scene agent time"]
    half_length: Float[Array, "scene agent"]  # [m]
    half_width: Float[Array, "scene agent"]  # [m]
    last: Int[Array, "scene agent"]  # last valid step
    target: Float[Array, "scene 2"]  # [m] target of the ego
    lights: UInt8[Array, "scene time bar"]
    road: Int[Array, " scene"]
    ground: Ground  # [road]
    bars: Box  # [scene bar]
    way: RouteAhead | None  # [scene] of the egos, if they are to follow their routes
    dt: float = eqx.field(static=True)
    camera: Camera = eqx.field(static=True)

    @property
    def steps(self) -> int:
        """The number of steps of every window."""
        return self.log.x.shape[2]

    @compiled
    def views(self, lesson: Lesson) -> UInt8[Array, "batch 192 192 3"]:
        """The view of each taught agent."""
        one_by_one = jax.default_backend() == "cpu"  # one picture at a time stays in the cache
        return jax.lax.map(self._view, lesson) if one_by_one else jax.vmap(self._view)(lesson)

    @compiled
    def targets(self, lesson: Lesson) -> Float[Array, "batch 2"]:
        """The target of each taught agent [m, its own frame]: its goal, or a point of the ego's route."""
        goal = lesson.goal if self.way is None else jax.vmap(lambda one: self._way(one).target(one.state))(lesson)
        return jax.vmap(to_frame)(goal[:, 0], goal[:, 1], lesson.state)

    @compiled
    def closed_lights(self, lesson: Lesson) -> Float[Array, " batch"]:
        """How near the next closed light of each is, from 0 to 1 (`RouteAhead`); 0 where no route is followed."""
        if self.way is None:
            return jnp.zeros_like(lesson.state.x)
        return jax.vmap(self.closed_light)(lesson)

    def closed_light(self, one: Lesson) -> Float[Array, ""]:
        """How near the next closed light of one lesson is, inside a program."""
        return self._way(one).light(one.state, one.step)

    @compiled
    def labels(self, lesson: Lesson) -> Float[Array, "batch waypoint 2"]:
        """The expert's waypoints [m, own frame]."""
        return jax.vmap(self.label)(lesson)

    def label(self, one: Lesson) -> Float[Array, "waypoint 2"]:
        """The expert's waypoints [m, own frame] for one lesson, inside a program."""
        log = jax.tree.map(lambda values: values[one.scene, one.agent], self.log)
        return expert_waypoints(log, self.last[one.scene, one.agent], one.step, one.state, self.dt)

    def _way(self, one: Lesson) -> RouteAhead:
        return jax.tree.map(lambda values: values[one.scene], self.way)

    def boxes(self, one: Lesson) -> tuple[Box, Bool[Array, " agent"]]:
        """The boxes of all agents at a lesson's step, and which of them are there, without the taught one."""
        now = jax.tree.map(lambda values: values[one.scene, :, one.step], self.log)
        sizes = (self.half_length[one.scene], self.half_width[one.scene])
        others = self.valid[one.scene, :, one.step] & (jnp.arange(now.x.shape[0]) != one.agent)
        return Box(now.x, now.y, jnp.cos(now.yaw), jnp.sin(now.yaw), *sizes), others

    def _view(self, one: Lesson) -> UInt8[Array, "192 192 3"]:
        boxes, others = self.boxes(one)
        speed = self.log.speed[one.scene, :, one.step]
        view = Surroundings(boxes, speed, others, self.lights[one.scene, one.step])
        road = self.road[one.scene]
        ground = Ground(self.ground.cells, self.ground.first[road], self.ground.shape[road], self.ground.corner[road])
        return observe(ground, jax.tree.map(lambda values: values[one.scene], self.bars), view, one.state, self.camera)


def to_frame(x: Float[Array, ""], y: Float[Array, ""], ego: Motion) -> Float[Array, " 2"]:
    """A point [m] in the frame of `ego`: ahead, left."""
    return jnp.stack(ahead_and_left(jnp, x - ego.x, y - ego.y, ego.yaw))


def gather(scenarios: Sequence[Scenario], given: NetworkInputs = AS_IN_THE_PAPERS) -> Classroom:
    """Put all `scenarios` on the device, for a network with the inputs `given`.

    Where egos follow their routes, targets and lights are those of their own ways (`own_way`), and only egos can be
    taught, as the ground is drawn around them alone. Raises RegentsError where horizons differ.
    """
    (count, dt), agents = common_horizon(scenarios), max(len(scenario.agents) for scenario in scenarios)
    patch, drawn = _patches(scenarios, given)
    tracks = [fill_gaps(scenario.tracks) for scenario in scenarios]

    def padded(values: Sequence[np.ndarray], dtype: type) -> np.ndarray:
        out = np.zeros((len(values), agents, *values[0].shape[1:]), dtype)
        for row, one in zip(out, values, strict=True):
            row[: len(one)] = one
        return out

    motion = [padded([getattr(t, name) for t in tracks], np.float32) for name in ("x", "y", "yaw", "speed")]
    valid = padded([t.valid for t in tracks], np.bool_)
    sizes = padded([np.array([(a.length, a.width) for a in s.agents]) for s in scenarios], np.float32)
    way = (
        stack_routes([RouteAhead.of(scenario, np.zeros(2)) for scenario in scenarios]) if given.follows_route else None
    )
    bars, lights = _bars(scenarios, count) if way is None else (way.bars, way.lights)
    return Classroom(
        log=Motion(*map(jnp.asarray, motion)),
        valid=jnp.asarray(valid),
        half_length=jnp.asarray(0.5 * sizes[..., 0]),
        half_width=jnp.asarray(0.5 * sizes[..., 1]),
        last=jnp.asarray(count - 1 - np.argmax(valid[..., ::-1], axis=-1)),
        target=jnp.array([scenario.target for scenario in scenarios], jnp.float32),
        lights=lights,
        road=jnp.array(patch),
        ground=_together(drawn, given.camera),
        bars=bars,
        way=way,
        dt=dt,
        camera=given.camera,
    )


def common_horizon(scenarios: Sequence[Scenario]) -> tuple[int, float]:
    """The number of steps and the time step [s] that all `scenarios` share. Raises RegentsError where they differ."""
    found = {(scenario.tracks.steps, scenario.dt) for scenario in scenarios}
    several = ", ".join(f"{(steps - 1) * dt:g} s in steps of {dt:g} s" for steps, dt in sorted(found)[:3])
    require(len(found) == 1, f"the cases have {len(found)} different horizons ({several}), expected one", RegentsError)
    return found.pop()


_Patch = tuple[np.ndarray, Float[np.ndarray, " 2"]]  # cells, and the position of cell (0, 0) [m]


def _patches(scenarios: Sequence[Scenario], given: NetworkInputs) -> tuple[list[int], list[_Patch]]:
    """The patch of drawn ground of each scenario as an index, and all patches.

    There is one patch per map; where its windows are too far apart for that, one per set of equal tracks. A patch
    covers all road users, or only egos where they follow their routes.
    """
    keys = [(id(scenario.road),) for scenario in scenarios]
    for key in set(keys):
        low, high = _around([s for s, own in zip(scenarios, keys, strict=True) if own == key], given)
        if np.prod((high - low) / given.camera.cell_m + 2.0) > MOST_CELLS:
            keys = [(*own, id(s.tracks)) if own == key else own for s, own in zip(scenarios, keys, strict=True)]
    found: dict[tuple[int, ...], list[Scenario]] = {}
    for scenario, key in zip(scenarios, keys, strict=True):
        found.setdefault(key, []).append(scenario)
    number = {key: index for index, key in enumerate(found)}
    return [number[key] for key in keys], [_draw(those, given) for those in found.values()]


def _draw(scenarios: Sequence[Scenario], given: NetworkInputs) -> _Patch:
    low, high = _around(scenarios, given)
    return draw_cells(scenarios[0].road, low, high, given.camera, _MOST_INDEX), low


def _around(
    scenarios: Sequence[Scenario], given: NetworkInputs
) -> tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]]:
    """The corners [m] of the area to draw around all tracks, or around egos alone."""
    around_m = given.camera.reach_m + _BEYOND_M
    those = slice(1) if given.follows_route else slice(None)
    positions = (np.stack([s.tracks.x[those], s.tracks.y[those]], axis=-1)[s.tracks.valid[those]] for s in scenarios)
    points = np.concatenate(list(positions))
    return points.min(axis=0) - around_m, points.max(axis=0) + around_m


def _together(drawn: Sequence[_Patch], camera: Camera) -> Ground:
    sizes = [cells.size for cells, _ in drawn]
    require(
        sum(sizes) <= _MOST_INDEX,
        f"the cases cover {sum(sizes) * camera.cell_m**2 / 1e6:.1f} km^2 of maps, expected "
        f"{_MOST_INDEX * camera.cell_m**2 / 1e6:.1f} at most (train on fewer or smaller maps)",
        RegentsError,
    )
    return Ground(
        cells=jnp.asarray(np.concatenate([cells.ravel() for cells, _ in drawn])),
        first=jnp.asarray(np.concatenate([[0], np.cumsum(sizes)[:-1]]), jnp.int32),
        shape=jnp.array([cells.shape for cells, _ in drawn], jnp.int32),
        corner=jnp.asarray(np.stack([low for _, low in drawn]), jnp.float32),
    )


def _bars(scenarios: Sequence[Scenario], steps: int) -> tuple[Box, UInt8[Array, "scene time bar"]]:
    found = [stop_bars(s.road, s.signals, steps, np.zeros(2)) for s in scenarios]
    size = max(bars.x.shape[0] for bars, _ in found)
    padded = [jax.tree.map(lambda v: jnp.pad(v, (0, size - v.shape[0])), bars) for bars, _ in found]
    lights = jnp.stack([jnp.pad(light, ((0, 0), (0, size - light.shape[1]))) for _, light in found])
    return jax.tree.map(lambda *values: jnp.stack(values), *padded), lights


# The expert for any state knows the log: it returns to where its log has it, in place and in time. It steers by pure
# pursuit on the logged path and accelerates like a critically damped spring between itself and its logged position. On
# its log it continues like the log, so its waypoints are the logged ones except where it cuts curves.
_SPRING = 0.25  # [1/s^2] per metre behind the log
_DAMPER = 1.0  # [1/s] per m/s slower than the log; 2 sqrt(spring) is critical damping
_MOST_ACCEL, _MOST_BRAKE = 3.0, 6.0  # [m/s^2]
_LOOK_AHEAD_S, _LEAST_LOOK_AHEAD_M = 0.5, 3.0  # of pure pursuit


def expert_waypoints(
    log: Motion, last: Int[Array, ""], now: Int[Array, ""], ego: Motion, dt: Float[Array, ""] | float
) -> Float[Array, "waypoint 2"]:
    """Waypoints [m, frame of `ego`] from the state `ego` at step `now` of its `log` [time], which ends at `last`."""
    along = distances_along(log.x, log.y, jnp)

    def advance(state: Motion, ahead: Array) -> tuple[Motion, Motion]:
        after = step(state, _controls(log, along, last, now + ahead, state, dt), dt)
        return after, after

    _, way = jax.lax.scan(advance, ego, jnp.arange(WAYPOINTS))
    return jax.vmap(to_frame, (0, 0, None))(way.x, way.y, ego)


def _controls(log: Motion, along: Array, last: Array, now: Array, ego: Motion, dt: Array | float) -> ControlArrays:
    steps = jnp.arange(log.x.shape[0])
    away = jnp.where(steps <= last, jnp.hypot(log.x - ego.x, log.y - ego.y), jnp.inf)
    nearest = jnp.argmin(away)
    cos, sin = jnp.cos(log.yaw[nearest]), jnp.sin(log.yaw[nearest])
    here = along[nearest] + (ego.x - log.x[nearest]) * cos + (ego.y - log.y[nearest]) * sin
    before, after = jnp.minimum(now, last - 1), jnp.minimum(now + 1, last)
    planned = (log.speed[after] - log.speed[before]) / dt
    accel = planned + _SPRING * (along[before] - here) + _DAMPER * (log.speed[before] - ego.speed)
    wanted = here + jnp.maximum(_LOOK_AHEAD_S * ego.speed, _LEAST_LOOK_AHEAD_M)
    beyond = jnp.maximum(wanted - along[last], 0.0)  # straight on where the log ends
    x = jnp.interp(wanted, along, log.x) + beyond * jnp.cos(log.yaw[last]) - ego.x
    y = jnp.interp(wanted, along, log.y) + beyond * jnp.sin(log.yaw[last]) - ego.y
    _, left = ahead_and_left(jnp, x, y, ego.yaw)
    accel = jnp.clip(accel, -_MOST_BRAKE, _MOST_ACCEL)
    return clip(ControlArrays(accel, 2.0 * left / jnp.maximum(x**2 + y**2, 1.0)))
