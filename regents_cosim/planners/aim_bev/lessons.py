"""Recorded traffic as lessons: any vehicle of any window at any step, with its view and its expert.

Everything lies on the device once; views are rendered when they are needed, which costs less
than reading them from disk and lets every pass see other perturbations.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt8

from regents_cosim.errors import RegentsError, require
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.mirror.actions import fill_gaps
from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.compiled import compiled
from regents_cosim.mirror.ground import CELL_M, Ground, draw_cells, stop_bars
from regents_cosim.mirror.observe import REACH_M, Surroundings, observe
from regents_cosim.mirror.separation import Box
from regents_cosim.planners.aim_bev.recovery import expert_waypoints
from regents_cosim.scenario import Scenario

_AROUND_M = REACH_M + 20.0  # drawn around all tracks
_MOST_CELLS = 2**31 - 1  # what an index of 32 bits reaches


class Lesson(eqx.Module):
    """Who is taught when, and in which state: the log's own, or one away from it."""

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
    target: Float[Array, "scene 2"]  # [m] where the ego is to go
    lights: UInt8[Array, "scene time bar"]
    road: Int[Array, " scene"]
    ground: Ground  # [road]
    bars: Box  # [scene bar]
    dt: float = eqx.field(static=True)

    @property
    def steps(self) -> int:
        """Of every window."""
        return self.log.x.shape[2]

    @compiled
    def views(self, lesson: Lesson) -> UInt8[Array, "batch 192 192 3"]:
        """What each of the taught sees."""
        return jax.lax.map(self._view, lesson)

    @compiled
    def targets(self, lesson: Lesson) -> Float[Array, "batch 2"]:
        """Where each of the taught is to go [m, its own frame]."""
        return jax.vmap(to_frame)(lesson.goal[:, 0], lesson.goal[:, 1], lesson.state)

    @compiled
    def labels(self, lesson: Lesson) -> Float[Array, "batch waypoint 2"]:
        """What the expert would do [m, own frame]."""

        def label(one: Lesson) -> Float[Array, "waypoint 2"]:
            log = jax.tree.map(lambda values: values[one.scene, one.agent], self.log)
            return expert_waypoints(log, self.last[one.scene, one.agent], one.step, one.state, self.dt)

        return jax.vmap(label)(lesson)

    def _view(self, one: Lesson) -> UInt8[Array, "192 192 3"]:
        now = jax.tree.map(lambda values: values[one.scene, :, one.step], self.log)
        sizes = (self.half_length[one.scene], self.half_width[one.scene])
        boxes = Box(now.x, now.y, jnp.cos(now.yaw), jnp.sin(now.yaw), *sizes)
        others = self.valid[one.scene, :, one.step] & (jnp.arange(now.x.shape[0]) != one.agent)
        view = Surroundings(boxes, now.speed, others, self.lights[one.scene, one.step])
        road = self.road[one.scene]
        ground = Ground(self.ground.cells, self.ground.first[road], self.ground.shape[road], self.ground.corner[road])
        return observe(ground, jax.tree.map(lambda values: values[one.scene], self.bars), view, one.state)


def to_frame(x: Float[Array, ""], y: Float[Array, ""], ego: Motion) -> Float[Array, " 2"]:
    """A point [m] in the frame of `ego`: ahead, left."""
    dx, dy, cos, sin = x - ego.x, y - ego.y, jnp.cos(ego.yaw), jnp.sin(ego.yaw)
    return jnp.stack([dx * cos + dy * sin, dy * cos - dx * sin])


def gather(scenarios: Sequence[Scenario]) -> Classroom:
    """All of `scenarios` on the device. Raises RegentsError where their horizons differ."""
    (count, dt), agents = common_horizon(scenarios), max(len(scenario.agents) for scenario in scenarios)
    roads = list({id(scenario.road): scenario.road for scenario in scenarios}.values())
    drawn = [_draw(road, [s for s in scenarios if s.road is road]) for road in roads]
    tracks = [fill_gaps(scenario.tracks) for scenario in scenarios]

    def padded(values: Sequence[np.ndarray], dtype: type) -> np.ndarray:
        out = np.zeros((len(values), agents, *values[0].shape[1:]), dtype)
        for row, one in zip(out, values, strict=True):
            row[: len(one)] = one
        return out

    motion = [padded([getattr(t, name) for t in tracks], np.float32) for name in ("x", "y", "yaw", "speed")]
    valid = padded([t.valid for t in tracks], np.bool_)
    sizes = padded([np.array([(a.length, a.width) for a in s.agents]) for s in scenarios], np.float32)
    bars, lights = _bars(scenarios, count)
    return Classroom(
        log=Motion(*map(jnp.asarray, motion)),
        valid=jnp.asarray(valid),
        half_length=jnp.asarray(0.5 * sizes[..., 0]),
        half_width=jnp.asarray(0.5 * sizes[..., 1]),
        last=jnp.asarray(count - 1 - np.argmax(valid[..., ::-1], axis=-1)),
        target=jnp.array([scenario.target for scenario in scenarios], jnp.float32),
        lights=lights,
        road=jnp.array([[road is s.road for road in roads].index(True) for s in scenarios]),
        ground=_together(drawn),
        bars=bars,
        dt=dt,
    )


def common_horizon(scenarios: Sequence[Scenario]) -> tuple[int, float]:
    """Steps and time step [s] that all of `scenarios` share. Raises RegentsError where they differ."""
    found = {(scenario.tracks.steps, scenario.dt) for scenario in scenarios}
    several = ", ".join(f"{(steps - 1) * dt:g} s in steps of {dt:g} s" for steps, dt in sorted(found)[:3])
    require(len(found) == 1, f"the cases have {len(found)} different horizons ({several}), expected one", RegentsError)
    return found.pop()


def _draw(road: RoadMap, scenarios: Sequence[Scenario]) -> tuple[np.ndarray, Float[np.ndarray, " 2"]]:
    """Cells of the road around all tracks, and their lower left corner [m]."""
    points = np.concatenate([np.stack([s.tracks.x, s.tracks.y], axis=-1)[s.tracks.valid] for s in scenarios])
    low = points.min(axis=0) - _AROUND_M
    return draw_cells(road, low, points.max(axis=0) + _AROUND_M), low


def _together(drawn: Sequence[tuple[np.ndarray, Float[np.ndarray, " 2"]]]) -> Ground:
    sizes = [cells.size for cells, _ in drawn]
    require(
        sum(sizes) <= _MOST_CELLS,
        f"the cases cover {sum(sizes) * CELL_M**2 / 1e6:.1f} km^2 of maps, expected "
        f"{_MOST_CELLS * CELL_M**2 / 1e6:.1f} at most (train on fewer or smaller maps)",
        RegentsError,
    )
    return Ground(
        cells=jnp.asarray(np.concatenate([cells.ravel() for cells, _ in drawn])),
        first=jnp.asarray(np.concatenate([[0], np.cumsum(sizes)[:-1]]), jnp.int32),
        shape=jnp.array([cells.shape for cells, _ in drawn], jnp.int32),
        corner=jnp.asarray(np.stack([low for _, low in drawn]), jnp.float32),
    )


def _bars(scenarios: Sequence[Scenario], steps: int) -> tuple[Box, UInt8[Array, "scene time bar"]]:
    """Stop bars and lights of all scenes, padded to the same number."""
    found = [stop_bars(s.road, s.signals, steps, np.zeros(2)) for s in scenarios]
    size = max(bars.x.shape[0] for bars, _ in found)
    padded = [jax.tree.map(lambda v: jnp.pad(v, (0, size - v.shape[0])), bars) for bars, _ in found]
    lights = jnp.stack([jnp.pad(light, ((0, 0), (0, size - light.shape[1]))) for _, light in found])
    return jax.tree.map(lambda *values: jnp.stack(values), *padded), lights
