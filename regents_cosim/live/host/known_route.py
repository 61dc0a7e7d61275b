"""The line that the ego's planner drives along, if it is known; it may differ from SUMO's route."""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from regents_cosim.errors import RegentsError, require
from regents_cosim.geometry.lines import evenly
from regents_cosim.live.predict.paths import SPACING_M, Path, joined, reach_within
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.routes.ego_route import speed_limits
from regents_cosim.routes.lane_matching import match_lanes

GivenRoute = ArrayLike | Callable[[Any], ArrayLike]

_OFF_IT_M = 10.0
_AS_NEAR_M = 1.5  # tolerance against the nearest point
_BEHIND_M = 10  # points behind: the body of the vehicle, and some more


class KnownRoute:
    """A line on a map."""

    def __init__(self, points: ArrayLike, road: RoadMap) -> None:
        """`points` [m] of the network. Raises RegentsError for anything but a line."""
        line = np.asarray(points, float)
        require(
            line.ndim == 2 and line.shape[0] > 1 and line.shape[1] == 2 and bool(np.isfinite(line).all()),
            f"a route of shape {line.shape}, expected two or more finite points x, y [m] of the network",
            RegentsError,
        )
        self._points, self._road = evenly(line, SPACING_M), road
        require(
            len(self._points) > 1, f"a route shorter than {SPACING_M:g} m, expected a line to drive along", RegentsError
        )
        self._limits: Float[np.ndarray, " point"] | None = None

    def ahead(self, front: tuple[float, float], yaw: float) -> Float[np.ndarray, "point 2"] | None:
        """The rest of the line, from a little behind a vehicle on; None if that is too far off, or at the end."""
        nearest = self._nearest(front, yaw)
        return None if nearest is None else self._points[max(nearest - _BEHIND_M, 0) :]

    def path(self, front: tuple[float, float], z: float, yaw: float, speed: float, seconds: float) -> Path | None:
        """The path of a vehicle on the line for some seconds; None as in `ahead`."""
        nearest = self._nearest(front, yaw)
        if nearest is None:
            return None
        if self._limits is None:
            self._limits = speed_limits(match_lanes(self._road, self._points, np.full(len(self._points), z)))
        points, limits = self._points[nearest:], self._limits[nearest:]
        return joined(points, limits, front, yaw, speed, reach_within(seconds, max(speed, float(limits[0]))))

    def _nearest(self, front: tuple[float, float], yaw: float) -> int | None:
        along = np.gradient(self._points, axis=0) @ [np.cos(yaw), np.sin(yaw)] > 0.0
        apart = np.where(along, np.hypot(*(self._points - front).T), np.inf)
        # A route may pass a place twice, as around a roundabout: the first time counts.
        close = np.flatnonzero(apart <= apart.min() + _AS_NEAR_M)
        first = close[: int(np.argmax([*(np.diff(close) > 1), True])) + 1]
        nearest = int(first[apart[first].argmin()])
        return None if apart[nearest] > _OFF_IT_M or nearest == len(apart) - 1 else nearest
