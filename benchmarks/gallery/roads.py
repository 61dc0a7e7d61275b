"""Simple roads made in code: straight ones, one with another road behind a hedge, a crossing."""

import numpy as np
import shapely

from regents_cosim.maps.roadmap import Lane, RoadMap

LANE_M = 3.2
_LIMIT_M_S = 15.0
_REACH_M = 200.0  # roads go on for that long beyond the origin, against +x
_AHEAD_M = 600.0  # and along it
_KERB_M = 4.0  # radius of the corners of a crossing

Point = tuple[float, float]


def straight_road(lanes: int) -> RoadMap:
    """Lanes along +x, the rightmost at y = 0."""
    return RoadMap(_parallel_lanes(lanes), (), _strip(-0.5 * LANE_M, (lanes - 0.5) * LANE_M))


def road_with_neighbour(lanes: int, hedge_m: float) -> tuple[RoadMap, float]:
    """A straight road, another of one lane to its left behind a hedge, and the y of that lane [m]."""
    edge = (lanes - 0.5) * LANE_M
    y = edge + hedge_m + 0.5 * LANE_M
    neighbour = _lane("neighbour", (-_REACH_M, y), (_AHEAD_M, y))
    drivable = shapely.union(_strip(-0.5 * LANE_M, edge), _strip(y - 0.5 * LANE_M, y + 0.5 * LANE_M))
    return RoadMap((*_parallel_lanes(lanes), neighbour), (), drivable), y


def crossing() -> RoadMap:
    """Two roads of two lanes that cross at the origin; one drives on the right.

    Lanes lie half a lane beside the axes: who drives along +x has y = -1.6, along +y x = 1.6.
    """
    far, side = _REACH_M, 0.5 * LANE_M
    ends: dict[str, tuple[Point, Point]] = {
        "east": ((-far, -side), (far, -side)),
        "west": ((far, side), (-far, side)),
        "north": ((side, -far), (side, far)),
        "south": ((-side, far), (-side, -far)),
    }
    # Up to the crossing and on behind it: markings do not run through it.
    lanes = [part for name, (start, end) in ends.items() for part in _outside(name, start, end)]
    area = shapely.union(shapely.box(-far, -LANE_M, far, LANE_M), shapely.box(-LANE_M, -far, LANE_M, far))
    return RoadMap(tuple(lanes), (), area.buffer(_KERB_M).buffer(-_KERB_M))


def _parallel_lanes(lanes: int) -> tuple[Lane, ...]:
    names = [f"lane{index}" for index in range(lanes)]
    return tuple(
        _lane(
            name,
            (-_REACH_M, index * LANE_M),
            (_AHEAD_M, index * LANE_M),
            left=names[index + 1] if index + 1 < lanes else None,
            right=names[index - 1] if index else None,
        )
        for index, name in enumerate(names)
    )


def _outside(name: str, start: Point, end: Point) -> tuple[Lane, Lane]:
    """A lane through the origin, without the middle of a crossing."""
    ways = np.array([start, end])
    heading = (ways[1] - ways[0]) / np.hypot(*(ways[1] - ways[0]))
    beside = ways[0] - heading * (ways[0] @ heading)
    before, behind = beside - (LANE_M + _KERB_M) * heading, beside + (LANE_M + _KERB_M) * heading
    return _lane(f"{name}_in", start, tuple(before)), _lane(f"{name}_out", tuple(behind), end)


def _lane(name: str, start: Point, end: Point, left: str | None = None, right: str | None = None) -> Lane:
    return Lane(name, np.array([start, end]), LANE_M, _LIMIT_M_S, left=left, right=right)


def _strip(low: float, high: float) -> shapely.Polygon:
    return shapely.box(-_REACH_M, low, _AHEAD_M, high)
