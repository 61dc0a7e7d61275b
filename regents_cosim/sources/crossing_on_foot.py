"""When a pedestrian may step onto a crossing so as to be in the way of an ego that drives over it.

The pedestrian walks straight to one end of the crossing, without touching the ego's path, and then over it. At a
crossing without lights the ego must still be far enough away to stop when the pedestrian steps on: stepping out closer
breaks the law (`verdicts.offences_on_foot`).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.maps.walkways import Walkway
from regents_cosim.norms.limits import RSS_BRAKE_M_S2, RSS_RESPONSE_S

_WALKS = 2.0  # [m/s] briskly: the median of recorded pedestrians is 1.4, the bound of an attack 3.0


@dataclass(frozen=True, eq=False)
class EgoPassage:
    """The event that an ego drives over a crossing."""

    crossing: Walkway
    path: shapely.LineString  # [m] the ego's path
    at: shapely.Point  # [m] where the path meets the middle of the crossing
    time_s: float
    speed: float  # [m/s] the ego's


def passage_over(
    crossing: Walkway, path: shapely.LineString, travelled: Float[np.ndarray, " time"], dt: float
) -> EgoPassage | None:
    """Where and when an ego first drives over a crossing; None if it does not.

    `path` is the ego's path [m], `travelled` how far along it the ego is [m] every `dt` [s].
    """
    met = shapely.get_parts(shapely.intersection(path, shapely.LineString(crossing.shape)))
    if not len(met):
        return None
    along, at = min((float(path.project(one.centroid)), number) for number, one in enumerate(met))
    step = min(int(np.searchsorted(travelled, along)), len(travelled) - 1)
    speed = float(travelled[step] - travelled[max(step - 1, 0)]) / dt
    return EgoPassage(crossing, path, met[at].centroid, step * dt, speed)


def steps_on_between(
    passed: EgoPassage, place: Float[np.ndarray, " 2"], since_s: float
) -> Iterator[tuple[float, float]]:
    """The earliest and latest times [s] at which a person may step on, for each end of the crossing.

    The person is at `place` [m] at the time `since_s` [s].
    """
    line = shapely.LineString(passed.crossing.shape)
    across_m = float(line.project(passed.at))
    seen_s = 0.0 if passed.crossing.signal is not None else RSS_RESPONSE_S + passed.speed / (2.0 * RSS_BRAKE_M_S2)
    for end, onward_m in ((0, across_m), (-1, line.length - across_m)):
        way = shapely.LineString([place, passed.crossing.shape[end]])
        soonest = since_s + way.length / _WALKS
        latest = passed.time_s - max(onward_m / _WALKS, seen_s)
        if soonest <= latest and not way.intersects(passed.path):
            yield soonest, latest
