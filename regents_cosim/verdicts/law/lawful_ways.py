"""Where an agent may lawfully drive: the lanes that lead on from its own, and lines along them.

The lanes are those under the agent when it is first seen that run in its direction, those along which it drove in its
log, their continuations (every turn that begins there) and the neighbours that it may change to; as far ahead as it
could come at 1.2 times the limit, or came in its log. Where no lane is under it, because the map has none or it stands
beside the road, all answers are None: unknown.

Source of the tolerance inside junctions: 1.6 m, half a lane of 3.2 m (SUMO's default width).
"""

from collections import defaultdict
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
import shapely
from jaxtyping import Float
from shapely.geometry.base import BaseGeometry
from shapely.ops import substring

from regents_cosim.geometry.areas import closed
from regents_cosim.geometry.frames import wrap
from regents_cosim.geometry.lines import distances_along, heading_near, stretch, without_repeats
from regents_cosim.maps.levels import drivable_at
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.norms.limits import ALONG_RAD, OVER_LIMIT
from regents_cosim.routes.ego_route import straightest
from regents_cosim.routes.lane_matching import match_lanes
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.verdicts.law.lane_pieces import lane_lines, lane_pieces, neighbours
from regents_cosim.verdicts.law.oncoming import OTHER_WAY_INSIDE_RAD, OTHER_WAY_RAD

OFF_WAY_M = 1.6  # tolerance of the centre from the middle of its way through a junction
MOST_WAYS = 12

_BEHIND_M = 20.0  # behind its first place; a lorry is 16 m long
_ROUNDING = 1e-6  # share of a spacing
_LOG_SPACING_M = 2.0  # of the points by which the log is matched
_LONGEST_M = 500.0
_MOST_LANES = 200  # in one way
_MOST_TRIED = 400  # unfinished ways
_JOIN_M = 6.0  # over which a way leads from the agent to the middle of its lane
_CHANGE_S = 4.0  # duration of a lane change: 3 to 6 s (Toledo and Zohar 2007)
_LEAST_CHANGE_M = 15.0
_SEAM_M = 0.2  # gaps between strips that are closed


@dataclass(frozen=True, eq=False)
class LawfulWay:
    """One way ahead: lanes that continue each other, and the line from the agent along their middle."""

    lanes: tuple[Lane, ...]
    points: Float[np.ndarray, "point 2"]  # [m] the first is the agent's position
    logged: bool  # whether its log takes this way
    changes: int  # number of lane changes


@dataclass(frozen=True)
class _Start:
    """Where an agent is first seen, and how far it may come."""

    step: int
    place: tuple[float, float]  # [m]
    z: float  # [m]
    yaw: float  # [rad]
    speed: float  # [m/s]
    lanes: dict[str, float]  # under it and in its direction, with the distance from their begin [m]
    logged: tuple[Lane, ...]  # of its log, in order
    reach_m: float


# --- the lanes ---------------------------------------------------------------------------------------


def lawful_lanes(scenario: Scenario, agent: int) -> tuple[Lane, ...] | None:
    """The lanes that an agent may use within the horizon; None where no lane is under it."""
    start = _start(scenario, agent)
    return None if start is None else tuple(scenario.road.lane[name] for name in _reached(scenario.road, start))


@lru_cache(maxsize=16)  # one search asks for the same agent repeatedly
def _start(scenario: Scenario, agent: int) -> _Start | None:
    tracks = scenario.recorded_tracks
    there = np.flatnonzero(tracks.valid[agent])
    if not len(there) or not scenario.road.lanes:
        return None
    step = int(there[0])
    x, y, z, yaw, speed = (float(v[agent, step]) for v in (tracks.x, tracks.y, tracks.z, tracks.yaw, tracks.speed))
    logged, travelled = _logged_lanes(scenario, agent)
    lanes = _lanes_of(scenario.road, (x, y), z, yaw)
    if logged and logged[0].id not in lanes:
        lanes = {logged[0].id: lane_lines(scenario.road)[logged[0].id].project(shapely.Point(x, y)), **lanes}
    if not lanes:
        return None
    limit = max(scenario.road.lane[name].speed_limit for name in lanes)
    seconds = (tracks.steps - 1 - step) * scenario.dt
    could = OVER_LIMIT * limit * seconds if np.isfinite(limit) else _LONGEST_M
    reach_m = min(max(could, 1.2 * travelled + 20.0), _LONGEST_M)
    return _Start(step, (x, y), z, yaw, speed, lanes, logged, reach_m)


def _lanes_of(road: RoadMap, place: tuple[float, float], z: float, yaw: float) -> dict[str, float]:
    at = lane_pieces(road).under(np.array([place]), z)
    along = np.abs(wrap(at.heading - yaw)) < ALONG_RAD
    pairs = zip(at.lane[along].tolist(), at.along[along].tolist(), strict=True)
    return {road.lanes[lane].id: along for lane, along in pairs}


def _logged_lanes(scenario: Scenario, agent: int) -> tuple[tuple[Lane, ...], float]:
    """The lanes along which an agent drove in its log, without repetitions in a row, and the distance [m]."""
    tracks = scenario.recorded_tracks
    there = tracks.valid[agent]
    x, y, z, yaw = (values[agent, there] for values in (tracks.x, tracks.y, tracks.z, tracks.yaw))
    driven = distances_along(x, y)
    chosen = np.flatnonzero(np.diff(np.floor(driven / _LOG_SPACING_M + _ROUNDING), prepend=-1.0) > 0)
    if len(chosen) < 2:  # it stands, so its heading alone tells the direction of its lane
        xy = np.array([[x[0], y[0]], [x[0] + 0.5 * np.cos(yaw[0]), y[0] + 0.5 * np.sin(yaw[0])]])
        matched = match_lanes(scenario.road, xy, np.full(2, z[0]))
    else:
        matched = match_lanes(scenario.road, np.stack([x[chosen], y[chosen]], axis=-1), z[chosen])
    lanes = [lane for lane in matched if lane is not None]
    return tuple(lane for lane, before in zip(lanes, [None, *lanes], strict=False) if lane is not before), driven[-1]


def _reached(road: RoadMap, start: _Start) -> dict[str, tuple[float, float]]:
    """The ids of the lanes that may be used, with the part of each [m from its begin]."""
    beside = neighbours(road)
    parts = dict[str, tuple[float, float]]()
    waiting = [(name, along, start.reach_m) for name, along in start.lanes.items()]
    waiting += [(lane.id, 0.0, start.reach_m) for lane in start.logged if lane.id not in start.lanes]
    left = defaultdict[str, float](lambda: -1.0)
    while waiting and len(parts) < _MOST_LANES:
        name, along, reach = waiting.pop(0)
        if reach <= left[name]:
            continue
        left[name] = reach
        lane = road.lane[name]
        since, until = parts.get(name, (np.inf, -np.inf))
        parts[name] = min(since, along - _BEHIND_M), max(until, min(along + reach, lane.length))
        waiting += [(other, _abreast(road, name, other, along), reach) for other in beside[name]]
        onward = reach - (lane.length - along)
        if onward > 0.0:
            waiting += [(target, 0.0, onward) for target in onward_lanes(road)[name]]
    return _with_what_is_behind(road, parts, set(start.lanes))


def _abreast(road: RoadMap, name: str, other: str, along: float) -> float:
    """The distance [m] from the begin of lane `other` of the place beside the point `along` a lane."""
    lines = lane_lines(road)
    return float(lines[other].project(lines[name].interpolate(along)))


def _with_what_is_behind(
    road: RoadMap, parts: dict[str, tuple[float, float]], first: set[str]
) -> dict[str, tuple[float, float]]:
    """The parts, extended by the lanes before the first ones where these begin less than 20 m behind the agent."""
    found = dict(parts)
    for name in first & parts.keys():
        for link in _entries(road)[name] if parts[name][0] < 0.0 else ():
            since = road.lane[link].length + parts[name][0]
            kept = found.get(link, (np.inf, -np.inf))
            found[link] = min(kept[0], since), max(kept[1], road.lane[link].length)
    return found


@lru_cache(maxsize=64)
def onward_lanes(road: RoadMap) -> dict[str, tuple[str, ...]]:
    """For every lane those that continue it; opposite lanes are left out, which a map may join by mistake."""
    return {
        name: tuple(link.target for link in links if _continues(road.lane[name], road.lane[link.target]))
        for name, links in road.exits.items()
    }


def _continues(lane: Lane, onward: Lane) -> bool:
    return float((lane.centre[-1] - lane.centre[-2]) @ (onward.centre[1] - onward.centre[0])) >= 0.0


@lru_cache(maxsize=64)
def _entries(road: RoadMap) -> dict[str, tuple[str, ...]]:
    found: dict[str, list[str]] = {lane.id: [] for lane in road.lanes}
    for source, targets in onward_lanes(road).items():
        for target in targets:
            found[target].append(source)
    return {target: tuple(sources) for target, sources in found.items()}


# --- the area ----------------------------------------------------------------------------------------


def lawful_area(scenario: Scenario, agent: int) -> BaseGeometry | None:
    """The area in which the body of an agent may be [m]; None where unknown.

    It consists of lanes in their width; of ways through a junction so wide that its centre may be 1.6 m off; and of
    what its body swept in its log. Places with only forbidden oncoming lanes are left out, and so is everything off the
    road.
    """
    start = _start(scenario, agent)
    if start is None:
        return None
    parts = _reached(scenario.road, start)
    body = 0.5 * scenario.agents[agent].width
    wide, own = [], []
    for name, (since, until) in parts.items():
        lane = scenario.road.lane[name]
        line = substring(lane_lines(scenario.road)[name], max(since, 0.0), until)
        if line.length > 0.0:
            half = 0.5 * lane.width
            own.append(line.buffer(half, cap_style="flat", quad_segs=2))
            inside = lane.junction and half < OFF_WAY_M + body
            wide.append(line.buffer(OFF_WAY_M + body, cap_style="flat", quad_segs=2) if inside else own[-1])
    lawful = shapely.union_all(own)
    oncoming = shapely.union_all(_oncoming_strips(scenario.road, parts, lawful))
    area = shapely.union_all([shapely.difference(shapely.union_all(wide), oncoming), lawful, _swept(scenario, agent)])
    area = closed(area, _SEAM_M)
    road = shapely.clip_by_rect(drivable_at(scenario.road, start.z), *area.bounds)
    return shapely.intersection(area, road)


def _swept(scenario: Scenario, agent: int) -> BaseGeometry:
    """The approximate area that the body of an agent swept in its log."""
    tracks = scenario.recorded_tracks
    there = tracks.valid[agent]
    points = np.column_stack([tracks.x[agent, there], tracks.y[agent, there]])
    if len(points) < 2:
        return shapely.Point()
    line = shapely.simplify(shapely.LineString(points), _SEAM_M)
    return line.buffer(0.5 * scenario.agents[agent].width, cap_style="square", quad_segs=2)


def _oncoming_strips(road: RoadMap, parts: dict[str, tuple[float, float]], lawful: BaseGeometry) -> list[BaseGeometry]:
    """Strips of unlawful lanes near the lawful ones that run against those beside them (see `oncoming`)."""
    near = road.centre_lines.query(lawful, predicate="dwithin", distance=OFF_WAY_M + 2.0)
    others = [road.lanes[i] for i in near.tolist() if road.lanes[i].id not in parts]
    lines = lane_lines(road)
    own = [lines[name] for name in parts]
    return [
        lines[lane.id].buffer(0.5 * lane.width, cap_style="flat", quad_segs=2)
        for lane in others
        if _turn(lines[lane.id], own) > (OTHER_WAY_INSIDE_RAD if lane.junction else OTHER_WAY_RAD)
    ]


def _turn(line: shapely.LineString, lines: list[shapely.LineString]) -> float:
    """The angle [rad] between a line and the nearest of `lines`, where the two are closest."""
    nearest = int(np.argmin(shapely.distance(lines, line)))
    place = shapely.Point(shapely.shortest_line(line, lines[nearest]).coords[0])
    return abs(float(wrap(heading_near(line, place) - heading_near(lines[nearest], place))))


# --- the ways ----------------------------------------------------------------------------------------


@lru_cache(maxsize=16)
def ways_ahead(scenario: Scenario, agent: int) -> tuple[LawfulWay, ...]:
    """The ways that an agent may take from where it is first seen, as far as it could come.

    There is one way for each turn and for each lane change within the first seconds. The way of its log comes first,
    then those that differ least from it; at most `MOST_WAYS`. Empty where no lane is under the agent.
    """
    start = _start(scenario, agent)
    if start is None:
        return ()
    tried = sorted(_sequences(scenario.road, start), key=lambda one: one[0])
    return tuple(_way(scenario.road, start, lanes, choices == 0) for (choices, _), lanes in tried[:MOST_WAYS])


_Rank = tuple[int, float]  # number of choices unlike the log's or the straightest, and the place of the first [m]


def _sequences(road: RoadMap, start: _Start) -> list[tuple[_Rank, tuple[str, ...]]]:
    """Sequences of lanes from the agent on, each with its difference from the logged one."""
    follows = {a.id: b.id for a, b in pairwise(start.logged)}
    first = start.logged[0].id if start.logged else next(iter(start.lanes))
    waiting: list[tuple[_Rank, tuple[str, ...], float]] = [
        ((0 if name == first else 1, 0.0), (name,), start.reach_m + along) for name, along in start.lanes.items()
    ]
    done = list[tuple[_Rank, tuple[str, ...]]]()
    while waiting and len(done) + len(waiting) < _MOST_TRIED:
        (choices, where), lanes, left = waiting.pop(0)
        here = road.lane[lanes[-1]]
        travelled = start.reach_m - left
        changed = len(lanes) > 1 and lanes[-1] in neighbours(road)[lanes[-2]]
        if not changed and (len(lanes) == 1 or follows.get(here.id) in neighbours(road)[here.id]):
            for other in neighbours(road)[here.id]:
                rank = (choices, where) if follows.get(here.id) == other else (choices + 1, where or travelled)
                waiting.append((rank, (*lanes, other), left))
        onward = [target for target in onward_lanes(road)[here.id] if target not in lanes]
        if left <= here.length or not onward:
            done.append(((choices, where), lanes))
            continue
        wanted = follows.get(here.id)
        if wanted not in onward:
            straight = straightest(here, [road.lane[other] for other in onward])
            wanted = straight and straight.id
        for other in onward:
            rank = (choices, where) if other == wanted else (choices + 1, where or travelled)
            waiting.append((rank, (*lanes, other), left - here.length))
    return done


def _way(road: RoadMap, start: _Start, names: tuple[str, ...], logged: bool) -> LawfulWay:
    lanes = tuple(road.lane[name] for name in names)
    points = [np.array([start.place])]
    since, changes, left = start.lanes[names[0]] + _JOIN_M, 0, start.reach_m - _JOIN_M
    for lane, after in zip(lanes, [*lanes[1:], None], strict=True):
        line = lane_lines(road)[lane.id]
        if after is not None and after.id in neighbours(road)[lane.id]:
            points.append(shapely.get_coordinates(line.interpolate(since)))
            since = _abreast(road, lane.id, after.id, since) + max(_CHANGE_S * start.speed, _LEAST_CHANGE_M)
            changes += 1
            continue
        points.append(stretch(shapely.get_coordinates(line), since, since + left))
        left -= max(line.length - since, 0.0)
        since = max(since - line.length, 0.0)
    return LawfulWay(lanes, without_repeats(np.concatenate(points)), logged, changes)
