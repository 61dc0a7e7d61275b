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
