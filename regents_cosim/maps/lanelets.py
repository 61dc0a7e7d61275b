"""The road as lanelets without holes: a ribbon for each lane, and pieces for the road that no ribbon covers.

Ribbons have one width, so between the ways through a junction and where lanes begin or end some of the road lies on
none of them. A planner that keeps to lanelets would take that for the edge of the road.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Float
from shapely.geometry.base import BaseGeometry

from regents_cosim.geometry.lines import steps_along
from regents_cosim.maps.roadmap import RoadMap

_SHARPEST = 0.25  # cosine of half the bend, below which bounds are not mitred further
_LEAST_STEP_M = 1e-3  # points closer than this give no direction
_OVERLAP_M = 0.01  # of ribbons and pieces side by side, because slits that come of rounding would be edges too


class Bounds(NamedTuple):
    """Both sides of a lanelet in the direction of travel [m]."""

    left: Float[np.ndarray, "point 2"]
    right: Float[np.ndarray, "point 2"]

    @property
    def area(self) -> BaseGeometry:
        """The surface between both sides."""
        return shapely.make_valid(shapely.Polygon(np.concatenate([self.left, self.right[::-1]])))


def ribbon(line: Float[np.ndarray, "point 2"], width: float) -> Bounds:
    """A centre line [m], moved by half the `width` [m] to each side, mitred at bends."""
    steps = np.diff(line, axis=0)
    kept = np.hypot(*steps.T) > _LEAST_STEP_M
    centre = line[np.concatenate([[True], kept])] if kept.any() else line[[0, -1]]
    along = np.diff(centre, axis=0)
    along /= np.maximum(np.hypot(*along.T), 1e-12)[:, None]
    normal = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    both = np.concatenate([normal[:1], normal]) + np.concatenate([normal, normal[-1:]])
    length = np.hypot(*both.T)  # twice the cosine of half the bend
    across = both / np.maximum(length, 1e-12)[:, None] / np.maximum(0.5 * length, _SHARPEST)[:, None]
    return Bounds(centre + 0.5 * width * across, centre - 0.5 * width * across)


def ribbons(road: RoadMap) -> dict[str, Bounds]:
    """Both sides of each lane, by its id."""
    return {lane.id: ribbon(lane.centre, lane.width + _OVERLAP_M) for lane in road.lanes}


def pieces_between(road: RoadMap) -> list[Bounds]:
    """The drivable area that no lane's ribbon covers, in pieces without holes."""
    covered = shapely.union_all([lane.area for lane in ribbons(road).values()])
    drivable = shapely.make_valid(road.drivable, method="structure", keep_collapsed=False)  # its edges may cross
    rest = shapely.buffer(shapely.difference(drivable, covered), _OVERLAP_M, join_style="mitre")
    rest = shapely.intersection(rest, drivable)
    return [_halved(piece) for part in shapely.get_parts(rest) for piece in _without_holes(part)]


def _without_holes(area: BaseGeometry) -> Iterator[shapely.Polygon]:
    """The polygons of an area, cut through the middle one of their holes until none has any."""
    for polygon in shapely.get_parts(area):
        if polygon.area == 0.0:
            continue  # a line or a point of an intersection
        if not polygon.interiors:
            yield polygon
            continue
        left, low, right, high = polygon.bounds
        holes = shapely.point_on_surface(shapely.polygons(polygon.interiors))
        at = float(np.sort(shapely.get_x(holes))[len(holes) // 2])
        for side in (shapely.box(left, low, at, high), shapely.box(at, low, right, high)):
            yield from _without_holes(shapely.intersection(polygon, side))


def _halved(polygon: shapely.Polygon) -> Bounds:
    """The outline as two sides of as many points, which lead from one of its far ends to the other."""
    ring = shapely.get_coordinates(shapely.orient_polygons(polygon).exterior)[:-1]
    hull = shapely.get_coordinates(polygon.convex_hull)
    far = hull[list(np.unravel_index(np.argmax(np.hypot(*(hull[:, None] - hull).T)), (len(hull),) * 2))]
    begin, end = sorted(int(np.argmin(np.hypot(*(ring - point).T))) for point in far)
    turned = np.roll(ring, -begin, axis=0)
    right, left = turned[: end - begin], turned[end - begin :][::-1]
    count = max(len(right), len(left), 2)
    return Bounds(_with_points(left, right[-1], count), _with_points(right, left[-1], count))


def _with_points(
    side: Float[np.ndarray, "some 2"], beyond: Float[np.ndarray, "2"], count: int
) -> Float[np.ndarray, "count 2"]:
    """The same side with `count` points, more on its longest part; a single point goes half way on to `beyond`."""
    if len(side) == 1:
        side = np.stack([side[0], 0.5 * (side[0] + beyond)])
    longest = int(np.argmax(steps_along(*side.T)))
    more = np.linspace(side[longest], side[longest + 1], count - len(side) + 2)[1:-1]
    return np.insert(side, longest + 1, more, axis=0)
