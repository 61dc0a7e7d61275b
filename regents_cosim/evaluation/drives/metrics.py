"""How well an ego drove, one short pure function per metric.

Source: the CARLA leaderboard's scores as KING (Hanselmann et al. 2022) uses them.
"""

import numpy as np
import shapely
from jaxtyping import Bool, Float

from regents_cosim.scenario import Kind

_OFF_ROUTE_M = 4.0  # further from its logged path the ego is on another road


def route_completion(route: Float[np.ndarray, "point 2"], driven: Float[np.ndarray, "time 2"]) -> float:
    """Share of the logged `route` [m] that the positions `driven` [m] reach; 1 for a route without length.

    Positions more than 4 m off the route count nothing, and beyond its end there is nothing to gain.
    """
    line = shapely.LineString(route)
    if line.length == 0.0:
        return 1.0
    points = shapely.points(driven)
    along, away = np.asarray(shapely.line_locate_point(line, points)), np.asarray(shapely.distance(line, points))
    reached = along[away <= _OFF_ROUTE_M]
    return float(reached.max(initial=0.0) / line.length)


def off_road_share(driven: Float[np.ndarray, "time 2"], off_road: Bool[np.ndarray, " time"]) -> float:
    """Share of the way driven [m] on which the ego was off the road, at the end of each step; 0 where it stood."""
    ways = np.hypot(*np.diff(driven, axis=0).T)
    total = ways.sum()
    return float((ways * off_road[1:]).sum() / total) if total > 0.0 else 0.0


def infraction_score(hit: Kind | None, off_road: float) -> float:
    """Product of penalties: 0.5 for hitting a pedestrian or cyclist, 0.6 for a vehicle; 1 - the share `off_road`."""
    penalty = 1.0 if hit is None else 0.5 if hit in ("pedestrian", "bicycle") else 0.6
    return penalty * (1.0 - off_road)


def driving_score(completion: float, infraction: float) -> float:
    """Completion times infraction score."""
    return completion * infraction
