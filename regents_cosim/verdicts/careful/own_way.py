"""The way that an ego drove, as a heading over the distance driven, with its continuation."""

from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.routes.ego_route import SPACING_M, plan_route
from regents_cosim.scenario import Scenario

_JOIN_M = 6.0  # length over which the driven way turns into the route
_SMOOTH_POINTS = 5  # for smoothing the route, as lanes have kinks


@dataclass(frozen=True, eq=False)
class OwnWay:
    """Heading over distance; positions follow from a start."""

    driven: Float[np.ndarray, " time"]  # [m] by each step
    distance: Float[np.ndarray, " point"]  # [m] increasing
    heading: Float[np.ndarray, " point"]  # [rad] continuous

    def turned(self, step: int, distance: Float[np.ndarray, "*axes"], tightest: float) -> Float[np.ndarray, "*axes"]:
        """The turn [rad] from `step` to `distance` [m] further on, with a curvature of at most `tightest` [1/m].

        Where the ego drove a tighter bend, the turn lags behind and catches up later: highway-env's cars change lanes
        with up to 30 m/s^2, beyond any tyres.
        """
        start = self.driven[step]
        ahead = np.append(0.0, self.distance[self.distance > start] - start)
        heading = np.interp(start + ahead, self.distance, self.heading)
        room = tightest * np.diff(ahead)
        if (np.abs(np.diff(heading)) > room).any():
            heading = _lagging(heading, room)
        return np.interp(distance, ahead, heading) - heading[0]


def _lagging(heading: Float[np.ndarray, " point"], room: Float[np.ndarray, " piece"]) -> Float[np.ndarray, " point"]:
    """Values that follow `heading` by at most `room` per piece."""
    followed = [float(heading[0])]
    for wanted, most in zip(heading[1:].tolist(), room.tolist(), strict=True):
        followed.append(min(max(wanted, followed[-1] - most), followed[-1] + most))
    return np.array(followed)


def own_way(scenario: Scenario) -> OwnWay:
    """The ego's track, continued along its route with the same lateral offset."""
    own = scenario.tracks
    travelled = 0.5 * (own.speed[0, :-1] + own.speed[0, 1:]) * scenario.dt
    driven = np.concatenate([[0.0], np.cumsum(travelled)])
    yaw = np.unwrap(own.yaw[0])
    ahead, heading = _route_ahead(scenario)
    further = ahead >= _JOIN_M
    turns = 2.0 * np.pi * np.round((yaw[-1] - heading[further][:1]) / (2.0 * np.pi))
    return OwnWay(
        driven,
        np.concatenate([driven, driven[-1] + ahead[further]]),
        np.concatenate([yaw, heading[further] + turns]),
    )


def _route_ahead(scenario: Scenario) -> tuple[Float[np.ndarray, " point"], Float[np.ndarray, " point"]]:
    """Distance from the end of the ego's track [m] and heading [rad] along its route."""
    points, own = plan_route(scenario).points, scenario.tracks
    end = shapely.LineString(points).project(shapely.Point(own.x[0, -1], own.y[0, -1]))
    along = np.diff(points, axis=0)
    heading = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
    padded = np.pad(heading, _SMOOTH_POINTS // 2, mode="edge")
    smooth = np.convolve(padded, np.full(_SMOOTH_POINTS, 1.0 / _SMOOTH_POINTS), mode="valid")
    return (np.arange(len(along)) + 0.5) * SPACING_M - end, smooth
