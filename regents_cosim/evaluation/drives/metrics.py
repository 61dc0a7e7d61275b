"""Metrics of an ego's drive, one short pure function each.

Source: the scores of the CARLA leaderboard 1.0, which KING (Hanselmann et al. 2022) uses. Its page on evaluation,
leaderboard.carla.org/evaluation_v1_0, lists the penalties: a collision with a pedestrian 0.50, with a vehicle 0.60, a
red light 0.70, off-road driving by its share. Its code, `leaderboard/utils/statistics_manager.py`, multiplies by 1 -
share, and `OutsideRouteLanesTest` of scenario_runner adds the distances off the road and in lanes of the wrong
direction.
"""

import numpy as np
import shapely
from jaxtyping import Bool, Float

from regents_cosim.scenario import Kind

_RED_LIGHT = 0.7
_OFF_ROUTE_M = 4.0  # farther from its logged path, the ego is on another road


def route_completion(route: Float[np.ndarray, "point 2"], driven: Float[np.ndarray, "time 2"]) -> float:
    """The share of the logged `route` [m] that the positions `driven` [m] reach; 1 for a route without length.

    Positions more than 4 m off the route do not count, and neither does the way beyond its end.
    """
    line = shapely.LineString(route)
    if line.length == 0.0:
        return 1.0
    points = shapely.points(driven)
    along, away = np.asarray(shapely.line_locate_point(line, points)), np.asarray(shapely.distance(line, points))
    reached = along[away <= _OFF_ROUTE_M]
    return float(reached.max(initial=0.0) / line.length)


def share_of_way(driven: Float[np.ndarray, "time 2"], holds: Bool[np.ndarray, " time"]) -> float:
    """The share of the driven distance [m] on which something held, at the end of each step; 0 where it stood."""
    ways = np.hypot(*np.diff(driven, axis=0).T)
    total = ways.sum()
    return float((ways * holds[1:]).sum() / total) if total > 0.0 else 0.0


def infraction_score(hit: Kind | None, outside: float, red_lights: int = 0) -> float:
    """Product of penalties: 0.5 for hitting a pedestrian or cyclist, 0.6 for a vehicle; 0.7 for each red light run.

    The share `outside` of the distance that is not on allowed lanes (off the road, or against the direction) counts as
    1 - share, as in the leaderboard's `OutsideRouteLanesTest`.
    """
    penalty = 1.0 if hit is None else 0.5 if hit in ("pedestrian", "bicycle") else 0.6
    return penalty * _RED_LIGHT**red_lights * (1.0 - outside)


def driving_score(completion: float, infraction: float) -> float:
    """Completion times infraction score."""
    return completion * infraction
