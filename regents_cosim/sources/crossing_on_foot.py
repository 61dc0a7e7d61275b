"""When someone on foot may step onto a crossing so as to be in the way of an ego that drives over it.

Straight to an end of the crossing, not through the ego's path, and over it. Where the crossing has no light, the ego
has to be so far off by then that it can stop: to step out closer breaks the law (`verdicts.offences_on_foot`).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.limits import RSS_BRAKE_M_S2, RSS_RESPONSE_S
from regents_cosim.maps.walkways import Walkway

_WALKS = 2.0  # [m/s] briskly: the median of recorded pedestrians is 1.4, the bound of an attack 3.0


@dataclass(frozen=True, eq=False)
class Passing:
    """An ego drives over a crossing."""

    crossing: Walkway
    path: shapely.LineString  # the ego's [m]
    at: shapely.Point  # where it meets the middle of the crossing [m]
    time_s: float
    speed: float  # [m/s] the ego's


def passing(
    crossing: Walkway, path: shapely.LineString, travelled: Float[np.ndarray, " time"], dt: float
) -> Passing | None:
    """Where and when an ego first drives over a crossing: its path [m], how far along it is [m] every `dt` [s].

    None where it does not.
    """
    met = shapely.get_parts(shapely.intersection(path, shapely.LineString(crossing.shape)))
    if not len(met):
        return None
    along, at = min((float(path.project(one.centroid)), number) for number, one in enumerate(met))
    step = min(int(np.searchsorted(travelled, along)), len(travelled) - 1)
    speed = float(travelled[step] - travelled[max(step - 1, 0)]) / dt
    return Passing(crossing, path, met[at].centroid, step * dt, speed)


def steps_on_between(passed: Passing, place: Float[np.ndarray, " 2"], since_s: float) -> Iterator[tuple[float, float]]:
    """The soonest and the latest time [s] to step on, for each end, of a person who is at a place [m] at `since_s`."""
    line = shapely.LineString(passed.crossing.shape)
    across_m = float(line.project(passed.at))
    seen_s = 0.0 if passed.crossing.signal is not None else RSS_RESPONSE_S + passed.speed / (2.0 * RSS_BRAKE_M_S2)
    for end, onward_m in ((0, across_m), (-1, line.length - across_m)):
        way = shapely.LineString([place, passed.crossing.shape[end]])
        soonest = since_s + way.length / _WALKS
        latest = passed.time_s - max(onward_m / _WALKS, seen_s)
        if soonest <= latest and not way.intersects(passed.path):
            yield soonest, latest
