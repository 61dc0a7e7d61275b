"""Distances, directions and pieces of lines, and ways that are driven along them."""

from typing import Any

import numpy as np
import shapely
from jaxtyping import Float, Int

_HALF_M = 0.5  # to each side of a place: the direction of a line is taken over one metre
_LAST_M = 3.0  # of a line: its direction at the end


def heading_near(line: shapely.LineString, place: shapely.Point) -> float:
    """The direction [rad] of a line over the metre around its point nearest to `place`, less where the line ends."""
    return float(headings_near(np.array([line]), np.array([place]))[0])


def headings_near(lines: np.ndarray, places: np.ndarray) -> Float[np.ndarray, " line"]:
    """The directions [rad] of many lines, each near a place of its own; see `heading_near`."""
    length = shapely.length(lines)
    at = np.minimum(np.maximum(shapely.line_locate_point(lines, places), _HALF_M), np.maximum(length - _HALF_M, 0.0))
    ends = (np.maximum(at - _HALF_M, 0.0), np.minimum(at + _HALF_M, length))
    begin, end = (shapely.get_coordinates(shapely.line_interpolate_point(lines, along)) for along in ends)
    ahead = end - begin
    return np.arctan2(ahead[:, 1], ahead[:, 0])


def end_heading(points: Float[np.ndarray, "point 2"]) -> float:
    """The direction [rad] of a line's last segment."""
    (x0, y0), (x1, y1) = points[-2:]
    return float(np.arctan2(y1 - y0, x1 - x0))


def end_direction(points: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, " 2"]:
    """The unit vector of a line at its end, over its last 3 m: a kink of a few centimetres does not count."""
    away = np.hypot(*(points - points[-1]).T)
    far = np.flatnonzero(away > _LAST_M)
    way = points[-1] - points[far[-1] if len(far) else int(away.argmax())]
    return way / np.hypot(*way)


def steps_along(x: Any, y: Any, xp: Any = np) -> Any:
    """Distances [m] from each point of a line to its next one [... segment]; `xp` is NumPy or jax.numpy."""
    return xp.hypot(xp.diff(x), xp.diff(y))


def length_of(points: Float[np.ndarray, "point 2"]) -> float:
    """The length of a line [m]."""
    return float(steps_along(*points.T).sum())


def without_repeats(points: Float[np.ndarray, "point n"], apart_m: float = 1e-3) -> Float[np.ndarray, "fewer n"]:
    """The points [m] of a line, without those within `apart_m` of the one before, seen from above; x, y come first."""
    x, y = points[:, :2].T
    return points[np.hypot(np.diff(x, prepend=x[:1] - 1.0), np.diff(y, prepend=y[:1] - 1.0)) > apart_m]


def distances_along(x: Any, y: Any, xp: Any = np) -> Any:
    """Distances [m] along a line from its first point to each of its points [... point]; `xp` is NumPy or jax.numpy."""
    return xp.concatenate([xp.zeros_like(x[..., :1]), xp.cumsum(steps_along(x, y, xp), axis=-1)], axis=-1)


def midway(values: Any) -> Any:
    """The means of every two values that follow each other [... step], of an array [... time] of NumPy or JAX."""
    return 0.5 * (values[..., :-1] + values[..., 1:])


def way_at(speed: Any, dt: Any, xp: Any = np) -> Any:
    """Distances [m] driven by each of the instants [... time], `dt` [s] apart, at speeds [m/s] that change evenly."""
    return xp.concatenate([xp.zeros_like(speed[..., :1]), xp.cumsum(midway(speed) * dt, axis=-1)], axis=-1)


def seconds_for(metres: Any, speed: Any, accel: Any, fastest: Any) -> Any:
    """The time [s] to drive some metres from a `speed` [m/s] with `accel` [m/s^2] up to the `fastest` speed.

    It is infinite where the fastest speed is 0.
    """
    gains_m = (fastest**2 - speed**2) / (2.0 * accel)
    gaining_s = (np.sqrt(speed**2 + 2.0 * accel * metres) - speed) / accel
    with np.errstate(divide="ignore", invalid="ignore"):
        steady_s = np.divide(metres - gains_m, fastest)
    return np.where(metres <= gains_m, gaining_s, (fastest - speed) / accel + steady_s)


def points_at(
    at: Float[np.ndarray, "*axes"] | float, along: Float[np.ndarray, " point"], points: Float[np.ndarray, "point n"]
) -> Float[np.ndarray, "*axes n"]:
    """The points of a line at distances `at` [m], given the distances `along` [m] of its points; see `np.interp`."""
    return np.stack([np.interp(at, along, values) for values in points.T], axis=-1)


def evenly(points: Float[np.ndarray, "point 2"], spacing_m: float) -> Float[np.ndarray, "even 2"]:
    """Points [m] along a line, `spacing_m` apart."""
    along = distances_along(*points.T)
    return points_at(np.arange(0.0, along[-1], spacing_m), along, points)


def straight_on(points: Float[np.ndarray, "point 2"], further_m: float) -> Float[np.ndarray, "point+1 2"]:
    """The line with one point more, which lies `further_m` [m] straight on behind its last two points."""
    ahead = points[-1] - points[-2]
    return np.vstack([points, points[-1] + further_m * ahead / max(float(np.hypot(*ahead)), 1e-9)])


def cubic(
    begin: Float[np.ndarray, " 2"],
    out: Float[np.ndarray, " 2"],
    end: Float[np.ndarray, " 2"],
    onto: Float[np.ndarray, " 2"],
    count: int,
) -> Float[np.ndarray, "count 2"]:
    """`count` points of the cubic of Hermite from `begin` to `end`, whose derivatives are `out` and `onto` there."""
    t = np.linspace(0.0, 1.0, count)[:, None]
    places = (1.0 - t) ** 2 * (1.0 + 2.0 * t) * begin + t**2 * (3.0 - 2.0 * t) * end
    return places + t * (1.0 - t) ** 2 * out - t**2 * (1.0 - t) * onto


def stretch(
    points: Float[np.ndarray, "point 2"], begin_m: float, end_m: float = np.inf
) -> Float[np.ndarray, "fewer 2"]:
    """The part of a line between two distances [m] along it; the end point twice where `begin_m` lies beyond the end.

    `shapely.ops.substring` does the same, but takes a hundred times as long where the points are close to each other.
    """
    along = distances_along(*points.T)
    begin, end = np.clip([begin_m, end_m], 0.0, along[-1])
    inside = points[(along > begin) & (along < end)]
    first, last = points_at(np.array([begin, end]), along, points)
    return np.vstack([first, inside, last])


class NearestPoint:
    """An index of points that finds the nearest one to a place."""

    def __init__(self, points: Float[np.ndarray, "point 2"]) -> None:
        self._tree = shapely.STRtree(np.asarray(shapely.points(points)))

    def __call__(self, x: Float[np.ndarray, "*axes"], y: Float[np.ndarray, "*axes"]) -> Int[np.ndarray, "*axes"]:
        """The index of the nearest point to each place [m]."""
        _, found = self._tree.query_nearest(np.asarray(shapely.points(x, y)).ravel(), all_matches=False)
        return found.reshape(np.shape(x))
