"""The lanes from the ego to its target and beyond, for drivers that need a route through a network."""

import heapq
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely

from regents_cosim.geometry.frames import Pose
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.routes.ego_route import lanes_ahead
from regents_cosim.routes.lane_matching import lanes_near

_REACH_M = 3.0  # farthest target from the centre line of its lane
_FAR_REACH_M = 10.0  # where none is so near
_OFF_CENTRE_COST = 10.0  # [m] of way that 1 m off the centre line costs, at either end
_CHANGE_COST_M = 20.0  # cost of a change to the lane beside ...
_ROOM_COST_M2 = 1000.0  # ... and this divided by what is left of the lane, as a short one leaves little room for it


def way_to_target(road: RoadMap, ego: Pose, z: float, target: tuple[float, float]) -> list[Lane]:
    """Lanes from the ego to the target and straight on behind it; a lane that the route leaves sideways is left out.

    The ego's road is at height `z` [m]. Where no lane leads to the target, the route goes straight on from the nearest
    lane.
    """
    starts = _under_ego(road, ego, z)
    way = _shortest(road, starts, _under_target(road, target)) or [_nearest(road, ego, starts)]
    driven = [lane for lane, after in pairwise(way) if after not in _beside(road.lane[lane])]
    return _and_onward(road, driven, way[-1])


def lanes_to_target(road: RoadMap, ego: Pose, z: float, target: tuple[float, float]) -> list[Lane]:
    """All lanes from the ego to the target and straight on behind it, also those that the route leaves sideways.

    Empty where the ego is on no lane, or none leads from there to the target.
    """
    starts = _under_ego(road, ego, z)
    way = _shortest(road, starts, _under_target(road, target) or _under_target(road, target, _FAR_REACH_M))
    return _and_onward(road, way[:-1], way[-1]) if way else []


def _and_onward(road: RoadMap, driven: list[str], last: str) -> list[Lane]:
    lanes = [road.lane[name] for name in driven]
    return lanes + [lane for lane in lanes_ahead(road, road.lane[last]) if lane not in lanes]


class _Start(NamedTuple):
    """A lane on which the ego may be taken to be."""

    cost: float  # [m]
    room: float  # [m] of the lane that is left


def _shortest(road: RoadMap, starts: dict[str, _Start], goals: dict[str, float]) -> list[str]:
    """The cheapest sequence of lane ids from a start to a goal, given the cost of each (Dijkstra 1959); [] if none."""
    waiting: list[tuple[float, tuple[str, ...], float, bool]] = [
        (one.cost, (name,), one.room, False) for name, one in starts.items()
    ]
    heapq.heapify(waiting)
    done: set[str] = set()
    while waiting:
        cost, way, room, arrived = heapq.heappop(waiting)
        if arrived:
            return list(way)
        here = road.lane[way[-1]]
        if here.id in done:
            continue
        done.add(here.id)
        if here.id in goals:
            heapq.heappush(waiting, (cost + goals[here.id], way, room, True))
        for link in road.exits[here.id]:
            heapq.heappush(waiting, (cost + here.length, (*way, link.target), road.lane[link.target].length, False))
        for name in _beside(here):
            change = _CHANGE_COST_M + _ROOM_COST_M2 / max(room, 1.0)
            heapq.heappush(waiting, (cost + change, (*way, name), room, False))
    return []


def _beside(lane: Lane) -> list[str]:
    return [name for name in (lane.left, lane.right) if name is not None]


def _nearest(road: RoadMap, ego: Pose, starts: dict[str, _Start]) -> str:
    """The id of the best start, or of the nearest lane if there is none."""
    if starts:
        return min(starts, key=lambda name: starts[name].cost)
    return road.lanes[int(road.centre_lines.nearest(shapely.Point(np.array([ego.x, ego.y]))))].id


def _under_ego(road: RoadMap, ego: Pose, z: float) -> dict[str, _Start]:
    """The lanes that run the ego's way at its place, by id.

    The part of a lane behind the ego costs nothing. So where one lane ends and the next begins at the ego, both cost
    the same.
    """
    here = np.array([ego.x, ego.y])
    ahead = here + 0.5 * np.array([np.cos(ego.yaw), np.sin(ego.yaw)])
    found: dict[str, _Start] = {}
    for lane, away in lanes_near(road, np.stack([here, ahead]), np.full(2, z))[0]:
        along = _along(lane, here)
        found[lane.id] = _Start(_OFF_CENTRE_COST * away - along, lane.length - along)
    return found


def _along(lane: Lane, place: np.ndarray) -> float:
    """The distance [m] along a lane of the point nearest to a place."""
    return float(shapely.line_locate_point(lane.line, shapely.Point(place)))


def _under_target(road: RoadMap, target: tuple[float, float], reach_m: float = _REACH_M) -> dict[str, float]:
    """Ids of the lanes under the target, and the cost [m] of each up to the target."""
    there = shapely.Point(target)
    found = road.centre_lines.query(there, predicate="dwithin", distance=reach_m)
    away = shapely.distance(road.centre_lines.geometries[found], there)
    return {
        road.lanes[i].id: _OFF_CENTRE_COST * float(off) + _along(road.lanes[i], np.array(target))
        for i, off in zip(found, away, strict=True)
    }
