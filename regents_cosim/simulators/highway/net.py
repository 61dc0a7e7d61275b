"""Turns a road network of highway-env into a RoadMap: sampled centre lines, connections, drivable area."""

import json
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
import shapely
from highway_env.road.lane import AbstractLane, StraightLane
from highway_env.road.road import LaneIndex, RoadNetwork
from jaxtyping import Float
from shapely.geometry.base import BaseGeometry

from regents_cosim.geometry.frames import points_from_highway, wrap
from regents_cosim.maps.roadmap import Approach, Connection, Lane, RoadMap

_SPACING_M = 1.0  # between the points of curved lanes
_MEET_M = 1.0  # a lane continues into one that begins this close to its end
_GAP_M, _OVERLAP_M = 8.0, 3.0  # ... or this far ahead of it, or behind it
_FILLET_M = 3.0  # radius of inner corners: IDM vehicles cut the corners of the roundabout by 0.3 m
_HALF_CAR_M = 2.5  # of highway-env's cars, which turn as they cross a gap
_CRACK_M = 0.05  # shapes this close touch
_SPEED_LIMIT = 30.0  # [m/s] of lanes without a limit: the top of highway-env's rewarded speeds


def road_map_of(network: RoadNetwork) -> RoadMap:
    """The RoadMap of a network; equal networks, which environments build again at every reset, share it."""
    return _road_map(_Network(json.dumps(network.to_config(), default=repr), network))


@dataclass(frozen=True)
class _Network:
    """A hashable network of highway-env, equal to another one if all of its lanes are equal."""

    lanes: str  # JSON
    network: RoadNetwork = field(compare=False)


@lru_cache(maxsize=8)
def _road_map(key: _Network) -> RoadMap:
    return to_road_map(key.network)


def to_road_map(network: RoadNetwork) -> RoadMap:
    """The RoadMap of a network. Lanes are named FROM-TO_INDEX after the nodes of the graph; index 0 is the leftmost."""
    lanes: dict[LaneIndex, Any] = {}  # highway-env's annotations lack the limits and rights
    for begin, onward in network.graph.items():
        lanes |= {(begin, end, i): lane for end, found in onward.items() for i, lane in enumerate(found)}
    links = [
        (lane, onward)
        for lane, onward in product(lanes, lanes)
        if onward[0] == lane[1] and _leads_on(lanes[lane], lanes[onward])
    ]
    connections = tuple(Connection(lane_name(lane), lane_name(onward)) for lane, onward in links)
    inside = {link.source for link in connections} & {link.target for link in connections}
    levels = {index: int(lane.priority) for index, lane in lanes.items() if lane_name(index) in inside}
    return RoadMap(
        lanes=tuple(_lane(index, lane, lanes, _approach(levels, index)) for index, lane in lanes.items()),
        connections=connections,
        drivable=_drivable(list(lanes.values()), [(lanes[lane], lanes[onward]) for lane, onward in links]),
    )


def lane_name(index: LaneIndex) -> str:
    """The name that the map gives to a lane of highway-env."""
    return f"{index[0]}-{index[1]}_{index[2]}"


def _approach(levels: dict[LaneIndex, int], index: LaneIndex) -> Approach | None:
    """What highway-env's levels of priority tell on a way through a junction; the rest are turns across others.

    Of the four levels of its intersection the upper two are those of the main road, where who turns left has less.
    """
    if index not in levels or len(set(levels.values())) == 1:
        return None
    middle = 0.5 * (min(levels.values()) + max(levels.values()))
    return "priority" if levels[index] > middle else "yields"


def _lane(index: LaneIndex, lane: Any, lanes: dict[LaneIndex, Any], approach: Approach | None) -> Lane:
    return Lane(
        id=lane_name(index),
        centre=points_from_highway(_centre(lane)),
        width=float(lane.width_at(0.0)),
        speed_limit=float(lane.speed_limit or _SPEED_LIMIT),
        left=_neighbour(index, -1, lanes),
        right=_neighbour(index, 1, lanes),
        approach=approach,
    )


def _neighbour(index: LaneIndex, offset: int, lanes: dict[LaneIndex, Any]) -> str | None:
    beside = (index[0], index[1], index[2] + offset)
    return lane_name(beside) if beside in lanes and not lanes[beside].forbidden else None


def _centre(lane: AbstractLane) -> Float[np.ndarray, "point 2"]:
    """Points of the centre line in highway-env's plane."""
    straight = type(lane) is StraightLane
    number = 2 if straight else max(2, round(lane.length / _SPACING_M) + 1)
    return np.array([lane.position(along, 0.0) for along in np.linspace(0.0, lane.length, number)])


def _leads_on(lane: AbstractLane, onward: AbstractLane) -> bool:
    """Whether a lane begins where the other ends, or behind a gap that an arc bridges.

    highway-env's roundabout has such gaps where roads join and leave the ring, and its racetracks have lanes that begin
    before the end of the one behind. Seen along the mean of both headings an arc leads straight ahead.
    """
    gap = onward.position(0.0, 0.0) - lane.position(lane.length, 0.0)
    end = lane.heading_at(lane.length)
    turn = float(wrap(np.asarray(onward.heading_at(0.0) - end)))
    middle = end + 0.5 * turn
    ahead, aside = gap @ [np.cos(middle), np.sin(middle)], gap @ [-np.sin(middle), np.cos(middle)]
    bridged = abs(turn) < 0.5 * np.pi and abs(aside) < _MEET_M and -_OVERLAP_M < ahead < _GAP_M
    return bool(np.hypot(*gap) < _MEET_M or bridged)


def _bridge(lane: AbstractLane, onward: AbstractLane) -> BaseGeometry | None:
    """The area that cars drive over, straight on, where a gap lies between two lanes; None where there is none."""
    half, end, begin = 0.5 * float(lane.width_at(0.0)), lane.position(lane.length, 0.0), onward.position(0.0, 0.0)
    yaw = lane.heading_at(lane.length)
    if (begin - end) @ [np.cos(yaw), np.sin(yaw)] < _MEET_M:
        return None
    sides = [lane.position(lane.length - back, left) for back in (0.0, _HALF_CAR_M) for left in (-half, half)]
    sides += [onward.position(on, left) for on in (0.0, _HALF_CAR_M) for left in (-half, half)]
    return shapely.MultiPoint(points_from_highway(np.array(sides))).convex_hull


def _drivable(lanes: list[AbstractLane], links: list[tuple[AbstractLane, AbstractLane]]) -> BaseGeometry:
    """The union of all lanes, with bridged gaps, round inner corners and no wedges where lanes meet at an angle."""
    lines = [shapely.LineString(points_from_highway(_centre(lane))) for lane in lanes]
    half_widths = [0.5 * float(lane.width_at(0.0)) for lane in lanes]
    ends = [shapely.Point(line.coords[end]) for end in (0, -1) for line in lines]
    where_others_go_on = [sum(end.distance(other) < _MEET_M for other in ends) > 1 for end in ends]
    joints = shapely.buffer(np.array(ends)[where_others_go_on], np.tile(half_widths, 2)[where_others_go_on])
    bridges = [bridge for one, onward in links if (bridge := _bridge(one, onward)) is not None]
    shapes = np.array([*shapely.buffer(lines, half_widths, cap_style="flat"), *joints, *bridges])
    area = shapely.union_all(shapes)
    corners = shapely.get_parts(area.buffer(_FILLET_M).buffer(-_FILLET_M).difference(area))
    beside: list[list[int]] = [[] for _ in corners]
    for corner, shape in shapely.STRtree(shapes).query(corners, "dwithin", distance=_CRACK_M).T.tolist():
        beside[corner].append(shape)
    # What lies between roads that do not meet there is no corner.
    kept = [
        corner
        for corner, around in zip(corners, beside, strict=True)
        if shapely.get_num_geometries(shapely.union_all(shapely.buffer(shapes[around], _CRACK_M))) == 1
    ]
    return shapely.union_all([area, *kept])
