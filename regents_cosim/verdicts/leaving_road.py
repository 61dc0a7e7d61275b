"""Decide whether a vehicle leaves the road, by its corners at the steps and by what its body sweeps between them.

No corner may be more than 0.3 m further off the road than it has been at its nearest so far. A corner that began on the
road may always be 0.3 m off it. A corner that began off it, of a parked vehicle or on a map that lacks a forecourt,
need not return at once, but may not go further away; once it is on the road it counts like the others. So a vehicle
that was parked beside a lawn may not cross it.

The swept area may be 0.3 m off the road and off what the vehicle sweeps in its log; more than 0.05 m^2 beyond that is
too much. This catches traffic islands and corners of blocks that pass between the corners of the box, and ways from a
car park that the map lacks: there only the log shows where one can drive.
"""

import numpy as np
import shapely
from jaxtyping import Bool
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
    off = beyond_road(road, corners(box), np.asarray(box.z)[..., None])
    return bool(np.any(off > OFF_ROAD_M + np.minimum.accumulate(off, axis=0)))


BoxAndPresence = tuple[Boxes, Bool[np.ndarray, " instant"]]


def leaves_road(road: RoadMap, box: Boxes, valid: Bool[np.ndarray, " time"], log: BoxAndPresence) -> bool:
    """Whether a vehicle leaves the road along `box` [time], at the `valid` steps and between them; `log` is its own."""
    there, follows = _present(box, valid)
    if corners_leave(road, there):
        return True
    pieces = _swept_off(road, there, follows)
    if pieces:
        shown = shapely.union_all(_swept(*_present(*log))).buffer(OFF_ROAD_M)
        pieces = [piece.difference(shown) for piece in pieces]
    return float(shapely.union_all(pieces).area) > SWEPT_OFF_ROAD_M2


def _present(box: Boxes, valid: Bool[np.ndarray, " time"]) -> tuple[Boxes, Bool[np.ndarray, " step"]]:
    """The boxes at the valid steps, and which of them follow each other."""
    steps = np.flatnonzero(valid)
    return Boxes(*(np.broadcast_to(values, valid.shape)[steps] for values in box)), np.diff(steps) == 1


def _swept(box: Boxes, follows: Bool[np.ndarray, " step"]) -> np.ndarray:
    """What a body sweeps between consecutive steps, in parts."""
    outline = corners(in_between(box, SUB_STEPS))
    swept = np.asarray(shapely.convex_hull(shapely.multipoints(np.concatenate([outline[:-1], outline[1:]], axis=1))))
    return swept[np.repeat(follows, SUB_STEPS)]


def _swept_off(road: RoadMap, box: Boxes, follows: Bool[np.ndarray, " step"]) -> list[BaseGeometry]:
    """The pieces [m] that a body sweeps further than 0.3 m off the road, between consecutive steps."""
    swept, z = _swept(box, follows), np.broadcast_to(box.z, (len(follows) + 1,))[:-1]
    levels = np.repeat(band(z[follows]), SUB_STEPS) if has_levels(road) else np.zeros(len(swept), int)
    return [
        piece
        for level in np.unique(levels).tolist()
        for piece in _beyond(drivable_at(road, level * BAND_M), swept[levels == level])
    ]


def _beyond(area: BaseGeometry, swept: np.ndarray) -> list[BaseGeometry]:
    """The pieces of the `swept` areas that are further than 0.3 m off `area`."""
    low_x, low_y, high_x, high_y = shapely.total_bounds(swept)
    near = shapely.clip_by_rect(area, low_x - _AROUND_M, low_y - _AROUND_M, high_x + _AROUND_M, high_y + _AROUND_M)
    shapely.prepare(near)  # a copy, as other threads may use `area` now
    out = ~shapely.covers(near, swept)
    if not out.any():
        return []
    grown = near.buffer(OFF_ROAD_M)
    return [piece.difference(grown) for piece in swept[out]]
