"""Lane centre lines on the device, to tell whether an agent keeps to a lane, and where it has to let the ego pass."""

from functools import lru_cache

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from regents_cosim.geometry.frames import along_and_left
from regents_cosim.geometry.lines import distances_along, points_at
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.mirror.programs.on_device import on_device, seen_from
from regents_cosim.norms.limits import SAME_WAY_COS
from regents_cosim.routes.yield_lines import yield_lines
from regents_cosim.scenario.scenario import Scenario

_SPACING_M = 1.0
_MARGIN_M = 10.0  # around the tracks of a scene
_REACH_M = 2.0
_SIZES = tuple(2**power for power in (11, 12, 14, 16))  # numbers of points; few shapes need few compilations
_FAR_M = 1e6


class LaneCentres(eqx.Module):
    """Points a metre apart along the centre lines around a scene; padding points are far away."""

    x: Float[Array, " point"]  # [m]
    y: Float[Array, " point"]  # [m]
    cos: Float[Array, " point"]  # of the lane's direction
    sin: Float[Array, " point"]
    line_m: Float[Array, " point"]  # [m] along the lane to a line where others have to let the ego pass; 0: none

    def off_centre(
        self, x: Float[Array, "*axes"], y: Float[Array, "*axes"], yaw: Float[Array, "*axes"]
    ) -> Float[Array, "*axes"]:
        """Distance [m] to the nearest centre line of a lane within 45 degrees of `yaw`; very large beyond 2 m.

        It is positive to the left of that line, and negative to its right.
        """
        _, off = self._near(x, y, yaw)
        nearest = jnp.argmin(jnp.abs(off), axis=-1, keepdims=True)
        return jnp.take_along_axis(off, nearest, axis=-1)[..., 0]

    def to_yield_line(
        self, x: Float[Array, "*axes"], y: Float[Array, "*axes"], yaw: Float[Array, "*axes"]
    ) -> Float[Array, "*axes"]:
        """Distance [m] along the lane to the line at which others have to let the ego pass; 0 where there is none."""
        along, off = self._near(x, y, yaw)
        return jnp.where((jnp.abs(off) <= _REACH_M) & (self.line_m > 0.0), self.line_m - along, 0.0).max(axis=-1)

    def _near(
        self, x: Float[Array, "*axes"], y: Float[Array, "*axes"], yaw: Float[Array, "*axes"]
    ) -> tuple[Float[Array, "*axes point"], Float[Array, "*axes point"]]:
        """How far a place is ahead of each point, and to the left of the line there (negative: to its right).

        Both are very far for lanes that run another way.
        """
        along, across = along_and_left(x[..., None] - self.x, y[..., None] - self.y, self.cos, self.sin)
        runs = jnp.cos(yaw)[..., None] * self.cos + jnp.sin(yaw)[..., None] * self.sin > SAME_WAY_COS
        away = jnp.where(jnp.abs(along) <= 0.6 * _SPACING_M, jnp.abs(across), jnp.hypot(along, across))
        return along, jnp.where(runs & (away <= _REACH_M), jnp.where(across < 0.0, -away, away), _FAR_M)


def lane_centres(
    scenario: Scenario, origin: Float[np.ndarray, " 2"], room: int = 0, around_ego_m: float | None = None
) -> LaneCentres:
    """The centre lines of lanes near the scene's tracks, on all levels, in the map's coordinates less `origin` [m].

    The result has room for at least `room` points. With `around_ego_m` it holds only points so near to a box around the
    ego's track.
    """
    tracks = scenario.tracks
    points, direction, to_end, lane = _along_lanes(scenario.road)
    beyond = yield_lines(scenario)
    beyond_m = np.array([beyond.get(one.id, -np.inf) for one in scenario.road.lanes])
    line_m = np.maximum(to_end + beyond_m[lane], 0.0)
    placed = np.stack([tracks.x, tracks.y], axis=-1)[tracks.valid]
    margin_m = _MARGIN_M
    if around_ego_m is not None:
        placed, margin_m = np.stack([tracks.x[0], tracks.y[0]], axis=-1), around_ego_m
    low, high = placed.min(axis=0) - margin_m, placed.max(axis=0) + margin_m
    near = ((points >= low) & (points <= high)).all(axis=1)
    points, direction = seen_from(points[near], origin), direction[near]
    size = next((size for size in _SIZES if size >= max(len(points), room)), len(points))
    extra = size - len(points)
    x, y = (np.pad(values, (0, extra), constant_values=_FAR_M) for values in points.T)
    angle, line_m = np.pad(direction, (0, extra)), np.pad(line_m[near], (0, extra))
    return LaneCentres(*(on_device(values, np.float32) for values in (x, y, np.cos(angle), np.sin(angle), line_m)))


@lru_cache(maxsize=8)
def _along_lanes(road: RoadMap) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points [m] a metre apart along all lanes.

    The others are the direction [rad] of the lane at each point, the distance [m] to its end, and its index.
    """
    points, directions, ends, lanes = [np.zeros((0, 2))], [np.zeros(0)], [np.zeros(0)], [np.zeros(0, int)]
    for index, lane in enumerate(road.lanes):
        steps = np.diff(lane.centre, axis=0)
        along = distances_along(*lane.centre.T)
        at = np.arange(0.5 * _SPACING_M, max(along[-1], _SPACING_M), _SPACING_M)
        piece = np.clip(np.searchsorted(along, at, side="right") - 1, 0, len(steps) - 1)
        points.append(points_at(at, along, lane.centre))
        directions.append(np.arctan2(steps[piece, 1], steps[piece, 0]))
        ends.append(along[-1] - at)
        lanes.append(np.full(len(at), index))
    return np.concatenate(points), np.concatenate(directions), np.concatenate(ends), np.concatenate(lanes)
