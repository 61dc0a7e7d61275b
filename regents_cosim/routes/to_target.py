"""The lanes from where the ego is to its target and on, for drivers that need a route through a network."""

import heapq
from itertools import pairwise

import numpy as np
import shapely

from regents_cosim.geometry.frames import Pose
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.routes.ego_route import lanes_ahead
from regents_cosim.routes.lane_matching import lanes_near

_REACH_M = 3.0  # of the target from the centre line of its lane
_OFF_CENTRE_COST = 10.0  # [m] of way that being 1 m off the centre line costs, at either end
_CHANGE_COST_M = 20.0  # to the lane beside


def way_to_target(road: RoadMap, ego: Pose, z: float, target: tuple[float, float]) -> list[Lane]:
    """Lanes that continue each other, past the target straight on; those that are left sideways are left out.

    The ego's road is at height `z` [m]. Where no lane leads to the target, straight on from the lane nearest to it.
    """
    starts = _under_ego(road, ego, z)
    way = _shortest(road, starts, _under_target(road, target)) or [min(starts, key=lambda name: starts[name])]
    driven = [lane for lane, after in pairwise(way) if after not in _beside(road.lane[lane])]
    lanes = [road.lane[name] for name in driven]
    onward = [lane for lane in lanes_ahead(road, road.lane[way[-1]]) if lane not in lanes]
    return lanes + onward


def _shortest(road: RoadMap, starts: dict[str, float], goals: dict[str, float]) -> list[str]:
    """The cheapest way from a start to a goal, given what each costs (Dijkstra 1959); [] where there is none."""
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
    """Lanes that run the ego's way where it is, or the nearest of all, and what each costs [m].

    What the ego has behind it of a lane costs nothing: of a lane and the one after it, at whose beginning the ego is,
    neither is dearer.
    """
    here = np.array([ego.x, ego.y])
    ahead = here + 0.5 * np.array([np.cos(ego.yaw), np.sin(ego.yaw)])
    near = lanes_near(road, np.stack([here, ahead]), np.full(2, z))[0]
    found = {lane.id: _OFF_CENTRE_COST * away - _along(lane, here) for lane, away in near}
    return found or {road.lanes[int(road.centre_lines.nearest(shapely.Point(here)))].id: 0.0}


def _along(lane: Lane, place: np.ndarray) -> float:
    """How far along a lane a place is [m]."""
    return float(shapely.line_locate_point(shapely.LineString(lane.centre), shapely.Point(place)))


def _under_target(road: RoadMap, target: tuple[float, float]) -> dict[str, float]:
    """Lanes under the target, and what each costs up to there [m]."""
    there = shapely.Point(target)
    found = road.centre_lines.query(there, predicate="dwithin", distance=_REACH_M)
    away = shapely.distance(road.centre_lines.geometries[found], there)
    return {
        road.lanes[i].id: _OFF_CENTRE_COST * float(off) + _along(road.lanes[i], np.array(target))
        for i, off in zip(found, away, strict=True)
    }
