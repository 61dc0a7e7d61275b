"""The lanes from the ego to its target and beyond, for drivers that need a route through a network."""

import heapq
from itertools import pairwise

import numpy as np
import shapely

from regents_cosim.geometry.frames import Pose
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.routes.ego_route import lanes_ahead
from regents_cosim.routes.lane_matching import lanes_near

_REACH_M = 3.0  # farthest target from the centre line of its lane
_OFF_CENTRE_COST = 10.0  # [m] of way that 1 m off the centre line costs, at either end
_CHANGE_COST_M = 20.0  # cost of a change to the lane beside


def way_to_target(road: RoadMap, ego: Pose, z: float, target: tuple[float, float]) -> list[Lane]:
    """Lanes from the ego to the target and straight on behind it; a lane that the route leaves sideways is left out.

    The ego's road is at height `z` [m]. Where no lane leads to the target, the route goes straight on from the nearest
    lane.
    """
    starts = _under_ego(road, ego, z)
    way = _shortest(road, starts, _under_target(road, target)) or [min(starts, key=lambda name: starts[name])]
    driven = [lane for lane, after in pairwise(way) if after not in _beside(road.lane[lane])]
    lanes = [road.lane[name] for name in driven]
    onward = [lane for lane in lanes_ahead(road, road.lane[way[-1]]) if lane not in lanes]
    return lanes + onward


def _shortest(road: RoadMap, starts: dict[str, float], goals: dict[str, float]) -> list[str]:
    """The cheapest sequence of lane ids from a start to a goal, given the cost of each (Dijkstra 1959); [] if none."""
    waiting: list[tuple[float, tuple[str, ...], bool]] = [(cost, (name,), False) for name, cost in starts.items()]
    heapq.heapify(waiting)
    done: set[str] = set()
    while waiting:
        cost, way, arrived = heapq.heappop(waiting)
        if arrived:
            return list(way)
        here = road.lane[way[-1]]
        if here.id in done:
            continue
        done.add(here.id)
        if here.id in goals:
            heapq.heappush(waiting, (cost + goals[here.id], way, True))
        for link in road.exits[here.id]:
            heapq.heappush(waiting, (cost + here.length, (*way, link.target), False))
        for name in _beside(here):
            heapq.heappush(waiting, (cost + _CHANGE_COST_M, (*way, name), False))
    return []


def _beside(lane: Lane) -> list[str]:
    return [name for name in (lane.left, lane.right) if name is not None]


def _under_ego(road: RoadMap, ego: Pose, z: float) -> dict[str, float]:
    """Ids and costs [m] of the lanes that run the ego's way at its place, or of the nearest lane if none does.

    The part of a lane behind the ego costs nothing. So where one lane ends and the next begins at the ego, both cost
    the same.
    """
    here = np.array([ego.x, ego.y])
    ahead = here + 0.5 * np.array([np.cos(ego.yaw), np.sin(ego.yaw)])
    near = lanes_near(road, np.stack([here, ahead]), np.full(2, z))[0]
    found = {lane.id: _OFF_CENTRE_COST * away - _along(lane, here) for lane, away in near}
    return found or {road.lanes[int(road.centre_lines.nearest(shapely.Point(here)))].id: 0.0}


def _along(lane: Lane, place: np.ndarray) -> float:
    """The distance [m] along a lane of the point nearest to a place."""
    return float(shapely.line_locate_point(shapely.LineString(lane.centre), shapely.Point(place)))


def _under_target(road: RoadMap, target: tuple[float, float]) -> dict[str, float]:
    """Ids of the lanes under the target, and the cost [m] of each up to the target."""
    there = shapely.Point(target)
    found = road.centre_lines.query(there, predicate="dwithin", distance=_REACH_M)
    away = shapely.distance(road.centre_lines.geometries[found], there)
    return {
        road.lanes[i].id: _OFF_CENTRE_COST * float(off) + _along(road.lanes[i], np.array(target))
        for i, off in zip(found, away, strict=True)
    }
