"""Decide whether a vehicle leaves the road, by its corners at the steps and by what its body sweeps between them.

No corner may be more than 0.3 m further off the road than it has been at its nearest so far. A corner that began on the
road may always be 0.3 m off it. A corner that began off it, of a parked vehicle or on a map that lacks a forecourt,
need not return at once, but may not go further away; once it is on the road it counts like the others. So a vehicle
that was parked beside a lawn may not cross it.

The swept area may be as far off the road as the furthest corner may be; more than 0.05 m^2 beyond that is too much.
This catches traffic islands and corners of blocks that pass between the corners of the box.
"""

import numpy as np
import shapely
from jaxtyping import Bool, Float
from shapely.geometry.base import BaseGeometry

from regents_cosim.geometry.boxes import Boxes, corners, in_between
from regents_cosim.maps.levels import BAND_M, band, beyond_road, drivable_at, has_levels
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.norms.limits import OFF_ROAD_M, SUB_STEPS, SWEPT_OFF_ROAD_M2

_AROUND_M = 1.0  # margin around the swept area within which the road is looked at


def corners_off_road(road: RoadMap, box: Boxes) -> Bool[np.ndarray, "*axes 4"]:
    """Which corners of boxes are more than 0.3 m off the road."""
    return beyond_road(road, corners(box), np.asarray(box.z)[..., None]) > OFF_ROAD_M


def corners_leave(road: RoadMap, box: Boxes) -> bool:
    """Whether a corner leaves the road along `box` [time], at the steps."""
    off, nearest = _off(road, box)
    return bool(np.any(off > OFF_ROAD_M + nearest))


def leaves_road(road: RoadMap, box: Boxes, valid: Bool[np.ndarray, " time"]) -> bool:
    """Whether a vehicle leaves the road along `box` [time], at the `valid` steps and between them."""
    steps = np.flatnonzero(valid)
    there = Boxes(*(np.broadcast_to(values, valid.shape)[steps] for values in box))
    if corners_leave(road, there):
        return True
    _, nearest = _off(road, there)
    return _swept_off(road, there, np.diff(steps) == 1, OFF_ROAD_M + nearest.max(axis=1)) > SWEPT_OFF_ROAD_M2


def _off(road: RoadMap, box: Boxes) -> tuple[Float[np.ndarray, "time 4"], Float[np.ndarray, "time 4"]]:
    """How far corners are off the road [m], and the least of that so far."""
    off = beyond_road(road, corners(box), np.asarray(box.z)[..., None])
    return off, np.minimum.accumulate(off, axis=0)


def _swept_off(
    road: RoadMap, box: Boxes, follows: Bool[np.ndarray, " step"], reach: Float[np.ndarray, " time"]
) -> float:
    """The area [m^2] swept further than `reach` [m] off the road, between consecutive steps."""
    outline = corners(in_between(box, SUB_STEPS))
    swept = np.asarray(shapely.convex_hull(shapely.multipoints(np.concatenate([outline[:-1], outline[1:]], axis=1))))
    pair = np.repeat(np.arange(len(follows)), SUB_STEPS)
    levels = band(np.broadcast_to(box.z, reach.shape))[pair] if has_levels(road) else np.zeros(len(pair), int)
    pieces = [
        piece
        for level in np.unique(levels).tolist()
        for piece in _beyond(
            drivable_at(road, level * BAND_M), *(v[follows[pair] & (levels == level)] for v in (swept, reach[pair]))
        )
    ]
    return float(shapely.union_all(pieces).area)


def _beyond(area: BaseGeometry, swept: np.ndarray, reach: Float[np.ndarray, " part"]) -> list[BaseGeometry]:
    """The pieces of the `swept` areas that are further than `reach` [m] off `area`."""
    margin = reach.max() + _AROUND_M
    low_x, low_y, high_x, high_y = shapely.total_bounds(swept)
    near = shapely.clip_by_rect(area, low_x - margin, low_y - margin, high_x + margin, high_y + margin)
    shapely.prepare(near)  # a copy, as other threads may use `area` now
    out = ~shapely.covers(near, swept)
    if not out.any():
        return []
    grown = {one: near.buffer(one) for one in np.unique(reach[out]).tolist()}
    return [piece.difference(grown[one]) for piece, one in zip(swept[out], reach[out].tolist(), strict=True)]
