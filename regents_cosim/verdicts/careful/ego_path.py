"""The ego's path: positions by distance driven, extended beyond the end of its drive."""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.geometry.lines import NearestPoint, way_at
from regents_cosim.norms.careful import swerve, swerve_length
from regents_cosim.routes.ego_route import SPACING_M, logged_way
from regents_cosim.scenario.scenario import Scenario

_SPACING_M = 0.5
_JOIN_M = 6.0  # length over which the driven way turns into the route
_SMOOTH_POINTS = 5  # for smoothing the route, as lanes have kinks
_FURTHER_M = 500.0  # straight extension beyond the end of the route, longer than any drive


@dataclass(frozen=True, eq=False)
class EgoPath:
    """Positions by distance along the way that the ego drove, and along its extension."""

    driven: Float[np.ndarray, " time"]  # [m] distance of the ego's own drive by each step
    distance: Float[np.ndarray, " point"]  # [m] increasing, of the positions below
    x: Float[np.ndarray, " point"]  # [m]
    y: Float[np.ndarray, " point"]  # [m]
    yaw: Float[np.ndarray, " point"]  # [rad] continuous

    def at(self, distance: Float[np.ndarray, "*axes"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """X, y [m] and yaw [rad] at distances [m]; distances before the path give its first point."""
        x, y, yaw = (np.interp(distance, self.distance, values) for values in (self.x, self.y, self.yaw))
        return x, y, yaw

    def up_to(self, distance: float) -> "EgoPath":
        """The path up to a distance [m], and straight on from there."""
        kept = self.distance <= distance
        x, y, yaw = (values[kept] for values in (self.x, self.y, self.yaw))
        ahead = _FURTHER_M * np.array([np.cos(yaw[-1]), np.sin(yaw[-1])])
        return EgoPath(
            driven=self.driven,
            distance=np.append(self.distance[kept], self.distance[kept][-1] + _FURTHER_M),
            x=np.append(x, x[-1] + ahead[0]),
            y=np.append(y, y[-1] + ahead[1]),
            yaw=np.append(yaw, yaw[-1]),
        )

    @cached_property
    def _dense(self) -> tuple[np.ndarray, NearestPoint]:
        along = np.arange(0.0, self.distance[-1] - _FURTHER_M, _SPACING_M)
        return along, NearestPoint(np.stack(self.at(along)[:2], axis=-1))

    def project(
        self, x: Float[np.ndarray, "*axes"], y: Float[np.ndarray, "*axes"]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Distance along the path and offset to its left [m] of positions [m], and the path's yaw [rad] there."""
        along, closest = self._dense
        nearest = along[closest(x, y)]
        path_x, path_y, yaw = self.at(nearest)
        dx, dy, cos, sin = x - path_x, y - path_y, np.cos(yaw), np.sin(yaw)
        return nearest + dx * cos + dy * sin, dy * cos - dx * sin, yaw


@lru_cache(maxsize=16)  # the verdicts and the tags of one crash ask for it
def ego_path(scenario: Scenario) -> EgoPath:
    """The ego's own track, then its route with the same lateral offset, then a straight line."""
    own = scenario.tracks
    driven, own_yaw = way_at(own.speed[0], scenario.dt), np.unwrap(own.yaw[0])
    ahead, heading = _route_ahead(scenario)
    further = ahead >= _JOIN_M
    turns = 2.0 * np.pi * np.round((own_yaw[-1] - heading[further][:1]) / (2.0 * np.pi))
    distance = np.concatenate([driven[-1:], driven[-1] + ahead[further]])
    heading = np.concatenate([own_yaw[-1:], heading[further] + turns])
    distance, heading = np.append(distance, distance[-1] + _FURTHER_M), np.append(heading, heading[-1])
    dense = np.append(np.arange(distance[0], distance[-2], _SPACING_M), distance[-2:])
    yaw = np.interp(dense, distance, heading)
    moved, mid = np.diff(dense), 0.5 * (yaw[:-1] + yaw[1:])
    return EgoPath(
        driven=driven,
        distance=np.concatenate([driven, dense[1:]]),
        x=np.concatenate([own.x[0], own.x[0, -1] + np.cumsum(moved * np.cos(mid))]),
        y=np.concatenate([own.y[0], own.y[0, -1] + np.cumsum(moved * np.sin(mid))]),
        yaw=np.concatenate([own_yaw, yaw[1:]]),
    )


def _route_ahead(scenario: Scenario) -> tuple[Float[np.ndarray, " point"], Float[np.ndarray, " point"]]:
    """Distance from the end of the ego's track [m] and heading [rad] along its route."""
    points, own = logged_way(scenario), scenario.tracks
    end = shapely.LineString(points).project(shapely.Point(own.x[0, -1], own.y[0, -1]))
    along = np.diff(points, axis=0)
    heading = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
    padded = np.pad(heading, _SMOOTH_POINTS // 2, mode="edge")
    smooth = np.convolve(padded, np.full(_SMOOTH_POINTS, 1.0 / _SMOOTH_POINTS), mode="valid")
    return (np.arange(len(along)) + 0.5) * SPACING_M - end, smooth


@dataclass(frozen=True, eq=False)
class EgoPositions:
    """Positions of the ego at every step, also beyond the horizon."""

    x: Float[np.ndarray, " time"]  # [m]
    y: Float[np.ndarray, " time"]  # [m]
    yaw: Float[np.ndarray, " time"]  # [rad]
    speed: Float[np.ndarray, " time"]  # [m/s]


def braking_positions(
    scenario: Scenario, path: EgoPath, speed: Float[np.ndarray, " step"], onset: int, shift_m: float = 0.0
) -> EgoPositions:
    """The drive with these speeds that moves aside by `shift_m` from the onset on."""
    distance = np.append(path.driven[:onset], path.driven[onset] + way_at(speed[onset:], scenario.dt))
    x, y, yaw = path.at(distance)
    if shift_m:
        length = swerve_length(np, speed[onset], shift_m)
        aside, turn = swerve(np, distance - path.driven[onset], length, shift_m)
        x, y, yaw = x - aside * np.sin(yaw), y + aside * np.cos(yaw), yaw + turn
    return EgoPositions(x, y, yaw, speed)
