"""The route of an ego from its start to its target: what the map tells, and nothing of what the log's driver did.

It has lanes in their order and a centre line by distance. All distances are in metres along that line, from the ego's
start. Frame: the map's own. `Scene.route` is the route of a scene; planners in JAX find it in `CompiledScene.route`.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from shapely.geometry.base import BaseGeometry

from regents_cosim.geometry.frames import Pose, ahead_and_left, wrap
from regents_cosim.maps.levels import height_on
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.routes.bodies import Bodies
from regents_cosim.routes.ego_route import SPACING_M, link_between, speed_limits
from regents_cosim.routes.give_way import Meeting, meetings
from regents_cosim.routes.lane_gaps import worth
from regents_cosim.routes.lane_matching import match_lanes
from regents_cosim.routes.route_line import ChangeOfLane, RouteLine, line_along, line_without_lanes
from regents_cosim.routes.to_target import lanes_to_target
from regents_cosim.scenario.scenario import RED, Scenario, Signal
from regents_cosim.short_repr import ShortRepr

_SMOOTH_POINTS = 5  # single kinks of a polyline are no curves
LEAST_AHEAD_M = 3.0  # of the point that pure pursuit aims at
AHEAD_S = 0.5
_ASIDE_M = 0.3  # on either side of an ego, in which others are in its way
_BEHIND_FRONT_M = 2.0  # others whose middle is further behind the ego's front are beside it, not ahead
_PLACES = 11  # at which a change of lanes is tried ...
_GAPS_WITHIN_M = 300.0  # ... within this distance, as others are expected no further
_AS_GOOD_M = 0.2  # a place that gets this much less far is as good, and the earlier in the list is taken


class OnRoute(NamedTuple):
    """Where a place lies beside the route."""

    along: Float[np.ndarray, "*axes"]  # [m]
    left: Float[np.ndarray, "*axes"]  # [m] to the left of the centre line, negative to the right
    yaw: Float[np.ndarray, "*axes"]  # [rad] of the route there


class RouteStretch(NamedTuple):
    """A part of the route, with a point every `SPACING_M`."""

    along: Float[np.ndarray, " point"]  # [m]
    points: Float[np.ndarray, "point 2"]  # [m]
    yaw: Float[np.ndarray, " point"]  # [rad]
    curvature: Float[np.ndarray, " point"]  # [1/m] positive turns left
    width: Float[np.ndarray, " point"]  # [m]
    speed_limit: Float[np.ndarray, " point"]  # [m/s]


@dataclass(frozen=True)
class RouteLane:
    """A lane of the route, with the stretch on which the route is in it."""

    lane: str
    begin_m: float
    end_m: float
    leaves_to: Literal["left", "right"] | None = None  # the side to which the route leaves it for the lane beside


@dataclass(frozen=True)
class RouteLight:
    """A stop line on the route, with the traffic light that holds there for the ego."""

    distance_m: float  # of the stop line
    lane: str
    to_lane: str
    signal: str
    link: int  # index of its letter among those of the signal

    def shows(self, signals: Iterable[Signal], step: int) -> str:
        """SUMO's letter that it shows at `step`; empty where the signal is not among those given."""
        return next((one.letters(step)[self.link] for one in signals if one.id == self.signal), "")


@dataclass(frozen=True, eq=False)
class StopLine:
    """A stop line on the route, with what its light shows over time."""

    distance_m: float  # along the route
    stop: Bool[np.ndarray, " time"]  # whether it shows red or yellow at that step
    red: Bool[np.ndarray, " time"]


@dataclass(frozen=True, eq=False, repr=False)
class Route(ShortRepr):
    """The centre line with a point every `SPACING_M` = 1 m, and what the map says along it.

    It begins at the ego's start, follows its lanes to the target and on beyond it, and then goes straight. Where the
    map has no lanes, or none leads to the target, it is a smooth curve from the start to the target.
    """

    points: Float[np.ndarray, "point 2"]  # [m]
    height: Float[np.ndarray, " point"]  # [m]
    width: Float[np.ndarray, " point"]  # [m] of the lane; NaN where the map has none
    speed_limit: Float[np.ndarray, " point"]  # [m/s]; infinite where the map tells none
    may_change_left: Bool[np.ndarray, " point"]  # whether the lane to the left may be entered here
    may_change_right: Bool[np.ndarray, " point"]
    lanes: tuple[RouteLane, ...]  # in their order; empty where the map has none
    changes: tuple[ChangeOfLane, ...]  # changes that the route needs: from where, and by where
    lights: tuple[RouteLight, ...]
    target: tuple[float, float]  # [m]
    road: RoadMap
    start: Pose  # of the ego
    speed: float  # [m/s] of the ego at the start, which gives the length of its lane changes
    by_lanes: bool  # whether lanes lead from the start to the target; otherwise the line is a smooth curve
    max_curvature: float = np.inf  # [1/m] limit of `pure_pursuit`, to either side: that of a `Control`
    _lanes: tuple[Lane, ...] = ()  # also those that the line passes over

    @property
    def length(self) -> float:
        """Its length [m]."""
        return SPACING_M * (len(self.points) - 1)

    @cached_property
    def target_m(self) -> float:
        """Where along the route the target is [m]."""
        return float(self.project(*self.target).along)

    @property
    def drivable(self) -> BaseGeometry:
        """The drivable area of the map, a polygon or several [m]."""
        return self.road.drivable

    @cached_property
    def along(self) -> Float[np.ndarray, " point"]:
        """The distance of each point [m]."""
        return SPACING_M * np.arange(len(self.points))

    @cached_property
    def yaw(self) -> Float[np.ndarray, " point"]:
        """The direction at each point [rad], continuous."""
        step = np.diff(self.points, axis=0, append=2.0 * self.points[-1:] - self.points[-2:-1])
        return np.unwrap(np.arctan2(step[:, 1], step[:, 0]))

    @cached_property
    def curvature(self) -> Float[np.ndarray, " point"]:
        """The curvature at each point [1/m], positive to the left, smoothed over 5 m as lanes have kinks."""
        padded = np.pad(self.yaw, _SMOOTH_POINTS, "edge")
        smooth = np.convolve(padded, np.ones(_SMOOTH_POINTS) / _SMOOTH_POINTS, "same")
        return np.gradient(smooth)[_SMOOTH_POINTS:-_SMOOTH_POINTS] / SPACING_M

    @cached_property
    def meetings(self) -> tuple[Meeting, ...]:
        """The ways of others that cross or join the route, in order, with the right of way at each but for lights."""
        begins, ends = [one.begin_m for one in self.lanes], [one.end_m for one in self.lanes]
        left = [index for index, one in enumerate(self.lanes) if one.leaves_to is not None]
        for index in left:  # what lies beside the line counts, too
            begins[index + 1] = begins[index]
        for index in reversed(left):
            ends[index] = ends[index + 1]
        parts = zip(begins, ends, strict=True)
        return meetings(self.road, self.points, dict(zip((one.lane for one in self.lanes), parts, strict=True)))

    def project(self, x: Float[np.ndarray, "*axes"] | float, y: Float[np.ndarray, "*axes"] | float) -> OnRoute:
        """The nearest places of the route to `x`, `y` [m], numbers or arrays. Raises ValueError for anything else."""
        try:
            place = np.stack(np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float)), axis=-1)
        except (TypeError, ValueError):
            raise ValueError(f"project({x!r}, {y!r}): expected two numbers, or arrays of one shape [m]") from None
        begin, step = self.points[:-1], np.diff(self.points, axis=0)
        part = ((place[..., None, :] - begin) * step).sum(axis=-1) / np.maximum((step**2).sum(axis=-1), 1e-12)
        foot = begin + np.clip(part, 0.0, 1.0)[..., None] * step
        nearest = np.hypot(*np.moveaxis(place[..., None, :] - foot, -1, 0)).argmin(axis=-1)
        share = np.take_along_axis(part, nearest[..., None], axis=-1)[..., 0]
        low, high = np.where(nearest > 0, 0.0, -np.inf), np.where(nearest < len(begin) - 1, 1.0, np.inf)
        yaw = self.yaw[nearest]
        away = place - begin[nearest]
        _, left = ahead_and_left(np, away[..., 0], away[..., 1], yaw)
        return OnRoute(SPACING_M * (nearest + np.clip(share, low, high)), left, yaw)

    def at(self, along: float) -> Pose:
        """The pose of the centre line at a distance [m]; straight on before its begin and beyond its end."""
        kept = float(np.clip(along, 0.0, self.length))
        index = min(int(kept / SPACING_M), len(self.points) - 2)
        yaw = float(self.yaw[index])
        x, y = self.points[index] + (along - SPACING_M * index) * np.array([np.cos(yaw), np.sin(yaw)])
        return Pose(float(x), float(y), float(wrap(np.asarray(yaw))))

    def ahead(self, along: float, length: float) -> RouteStretch:
        """The route from a distance [m] on, over a `length` [m]. Raises ValueError unless both are finite."""
        if not np.isfinite([along, length]).all():
            raise ValueError(f"ahead({along!r}, {length!r}): expected two finite numbers [m]")
        begin = int(np.clip(np.ceil(along / SPACING_M), 0, len(self.points) - 1))
        part = slice(begin, max(begin + int(length / SPACING_M) + 1, begin + 1))
        values = self.along, self.points, self.yaw, self.curvature, self.width, self.speed_limit
        return RouteStretch(*(one[part] for one in values))

    def pure_pursuit(self, x: float, y: float, yaw: float, speed: float, ahead_s: float = AHEAD_S) -> float:
        """The curvature [1/m] that leads back to the centre line (Coulter 1992), for `Control` and within its limit.

        It aims at the point that the ego reaches after `ahead_s` [s], at least 3 m ahead.
        """
        along = float(self.project(x, y).along)
        goal = self.at(along + max(ahead_s * speed, LEAST_AHEAD_M))
        wanted = curvature_through(float(goal.x) - x, float(goal.y) - y, yaw)
        return float(np.clip(wanted, -self.max_curvature, self.max_curvature))

    def next_ahead(self, front: float, width: float, others: Bodies) -> tuple[int, float] | None:
        """The index of the next of `others` in the way, and the gap to its rear [m]; None without one.

        The way is as wide as an ego of `width` [m] with 0.3 m on either side, and begins at its `front` [m].
        """
        place = self.project(others.x, others.y)
        turn = others.yaw - place.yaw
        cos, sin = np.abs(np.cos(turn)), np.abs(np.sin(turn))
        half_length, half_width = 0.5 * others.length, 0.5 * others.width
        reach, breadth = cos * half_length + sin * half_width, sin * half_length + cos * half_width
        inside = np.abs(place.left) - breadth < 0.5 * width + _ASIDE_M
        ahead = others.valid & inside & (place.along > front - _BEHIND_FRONT_M) & (place.along < self.length)
        if not ahead.any():
            return None
        index = int(np.argmin(np.where(ahead, place.along - reach, np.inf)))
        return index, float(place.along[index] - reach[index] - front)

    def changing_at(self, *begin_m: float) -> "Route":
        """The same route whose needed lane changes begin at these distances [m], one for each of `changes`.

        A change begins no earlier than its `from_m`, and early enough to be over by its `until_m`.
        """
        line = line_along(self._lanes, self.start, self.speed, self.target, begin_m) if self.changes else None
        if line is None:
            return self
        changed = _route(self.road, self._lanes, line, self.start, self.speed, self.target)
        return replace(changed, max_curvature=self.max_curvature)

    def into_gaps(self, length: float, width: float, others: Bodies) -> "Route":
        """The same route with lane changes where they keep clear of the `others` at the start (`lane_gaps`).

        `length` and `width` [m] are the ego's.
        """
        if not self.changes:
            return self
        first, last = self.changes[0].from_m, max(self.changes[-1].until_m, self.changes[0].from_m)
        places = np.linspace(first, min(last, first + _GAPS_WITHIN_M), _PLACES)
        routes = [self, *(self.changing_at(*[place] * len(self.changes)) for place in places.tolist())]
        state = self.speed, float(self.speed_limit[0]), (length, width)
        gained = np.array([worth(route.points, *state, others) for route in routes])
        return routes[int(np.argmax(gained > gained.max() - _AS_GOOD_M))]

    def stop_lines(self, signals: Iterable[Signal], steps: int) -> tuple[StopLine, ...]:
        """Its lights over all `steps` of a scene with these `signals`."""
        known = {signal.id: signal for signal in signals}
        found = []
        for light in self.lights:
            if light.signal in known:
                letters = [known[light.signal].letters(step)[light.link] for step in range(steps)]
                stop, red = (np.array([letter in shown for letter in letters]) for shown in ("ryu", RED))
                found.append(StopLine(light.distance_m, stop, red))
        return tuple(found)


def curvature_through(dx: float, dy: float, yaw: float) -> float:
    """The curvature [1/m] of the arc that leads a pose with this yaw [rad] to a point `dx`, `dy` [m] away from it."""
    return 2.0 * float(ahead_and_left(np, dx, dy, yaw)[1]) / max(dx * dx + dy * dy, 1.0)


def route_to(road: RoadMap, start: Pose, z: float, speed: float, target: tuple[float, float]) -> Route:
    """The route of an ego that starts at a pose and height [m] with a speed [m/s], to its target [m]."""
    lanes = tuple(lanes_to_target(road, start, z, target))
    if lanes:
        return _route(road, lanes, line_along(lanes, start, speed, target, None), start, speed, target)
    return _matched(road, line_without_lanes(start, target).points, z, start, speed, target)


def _matched(
    road: RoadMap,
    points: Float[np.ndarray, "point 2"],
    z: Float[np.ndarray, " point"] | float,
    start: Pose,
    speed: float,
    target: tuple[float, float],
) -> Route:
    """The route on given points, with the lanes that are under them."""
    matched = match_lanes(road, points, np.broadcast_to(np.asarray(z, float), len(points)))
    under = tuple({lane.id: lane for lane in matched if lane is not None}.values())
    index = {lane.id: number for number, lane in enumerate(under)}
    on = np.array([-1 if lane is None else index[lane.id] for lane in matched])
    first = {number: SPACING_M * float(np.argmax(on == number)) for number in range(len(under))}
    return _route(road, under, RouteLine(points, on, first, ()), start, speed, target, by_lanes=False)


@lru_cache(maxsize=16)  # the planner under test and those that it is compared with ask for the same
def route_of(scenario: Scenario) -> Route:
    """The route of a scenario's ego."""
    return route_to(scenario.road, *_start(scenario), scenario.target)


def route_on(scenario: Scenario, way: Float[np.ndarray, "point 2"]) -> Route:
    """The route of a scenario's ego along another `way` [m], which has a point every `SPACING_M`."""
    start, _, speed = _start(scenario)
    return _matched(scenario.road, way, scenario.heights.of(0, *way.T), start, speed, scenario.target)


@lru_cache(maxsize=16)
def route_into_gaps(scenario: Scenario) -> Route:
    """The route that our planners follow: with lane changes into the gaps that the ego sees at the first step."""
    route, tracks, ego = route_of(scenario), scenario.tracks, scenario.ego
    seen = tracks.x, tracks.y, tracks.yaw, tracks.speed, tracks.valid, tracks.z
    return route.into_gaps(ego.length, ego.width, Bodies(scenario.agents[1:], *(values[1:, 0] for values in seen)))


def _start(scenario: Scenario) -> tuple[Pose, float, float]:
    """The ego's pose, height [m] and speed [m/s] at first."""
    tracks = scenario.tracks
    state = tracks.x, tracks.y, tracks.yaw, tracks.z, tracks.speed
    x, y, yaw, z, speed = (float(values[0, 0]) for values in state)
    return Pose(x, y, yaw), z, speed


def _route(
    road: RoadMap,
    lanes: tuple[Lane, ...],
    line: RouteLine,
    start: Pose,
    speed: float,
    target: tuple[float, float],
    by_lanes: bool = True,
) -> Route:
    """The route on a line, with what the lanes tell."""
    under = [lanes[index] if index >= 0 else None for index in line.lane.tolist()]
    height = np.zeros(len(under))
    for index in np.unique(line.lane[line.lane >= 0]).tolist() if road.raised else []:
        here = line.lane == index
        height[here] = height_on(lanes[index], line.points[here])
    order = sorted(line.begins, key=lambda index: line.begins[index])
    ends = [*(line.begins[index] for index in order[1:]), SPACING_M * (len(line.points) - 1)]
    found, lights = list[RouteLane](), list[RouteLight]()
    for index, after, end in zip(order, [*order[1:], None], ends, strict=False):
        lane, next_lane = lanes[index], None if after is None else lanes[after]
        side = None if next_lane is None else _side(lane, next_lane)
        found.append(RouteLane(lane.id, line.begins[index], end, side))
        link = link_between(road, lane, next_lane)
        if link is not None and link.signal is not None:
            lights.append(RouteLight(end, lane.id, link.target, link.signal, link.link))
    return Route(
        points=line.points,
        height=height,
        width=np.array([np.nan if lane is None else lane.width for lane in under]),
        speed_limit=speed_limits(under),
        may_change_left=np.array([lane is not None and lane.left is not None for lane in under]),
        may_change_right=np.array([lane is not None and lane.right is not None for lane in under]),
        lanes=tuple(found),
        changes=line.changes,
        lights=tuple(lights),
        target=target,
        road=road,
        start=start,
        speed=speed,
        by_lanes=by_lanes,
        _lanes=lanes,
    )


def _side(lane: Lane, after: Lane) -> Literal["left", "right"] | None:
    return "left" if after.id == lane.left else "right" if after.id == lane.right else None
