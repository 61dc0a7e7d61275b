"""Reads the routes of the vehicles around in SUMO, and the places where they have to wait, without changing them.

The line that the ego's planner drives along may differ from SUMO's route, if it is known (`KnownRoute`).
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from regents_cosim.errors import RegentsError, require
from regents_cosim.geometry.frames import wrap
from regents_cosim.geometry.lines import evenly
from regents_cosim.live.predict.paths import (
    BEFORE_LINE_M,
    SPACING_M,
    Crossing,
    LaneChains,
    Path,
    Stop,
    joined,
    path_along,
    reach_within,
)
from regents_cosim.live.predict.traffic import Shows
from regents_cosim.maps.right_of_way import Priorities, priorities
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.norms.limits import ALONG_RAD, STANDING_M_S
from regents_cosim.routes.ego_route import lanes_ahead, speed_limits
from regents_cosim.routes.lane_matching import match_lanes
from regents_cosim.verdicts.law.lane_pieces import lane_pieces

GivenRoute = ArrayLike | Callable[[Any], ArrayLike]

_OFF_IT_M = 10.0
_AS_NEAR_M = 1.5  # tolerance against the nearest point
_BEHIND_M = 10  # points behind: the body of the vehicle, and some more


class KnownRoute:
    """A line on a map."""

    def __init__(self, points: ArrayLike, road: RoadMap) -> None:
        """`points` [m] of the network. Raises RegentsError for anything but a line."""
        line = np.asarray(points, float)
        require(
            line.ndim == 2 and line.shape[0] > 1 and line.shape[1] == 2 and bool(np.isfinite(line).all()),
            f"a route of shape {line.shape}, expected two or more finite points x, y [m] of the network",
            RegentsError,
        )
        self._points, self._road = evenly(line, SPACING_M), road
        require(
            len(self._points) > 1, f"a route shorter than {SPACING_M:g} m, expected a line to drive along", RegentsError
        )
        self._limits: Float[np.ndarray, " point"] | None = None

    def ahead(self, front: tuple[float, float], yaw: float) -> Float[np.ndarray, "point 2"] | None:
        """The rest of the line, from a little behind a vehicle on; None if that is too far off, or at the end."""
        nearest = self._nearest(front, yaw)
        return None if nearest is None else self._points[max(nearest - _BEHIND_M, 0) :]

    def path(self, front: tuple[float, float], z: float, yaw: float, speed: float, seconds: float) -> Path | None:
        """The path of a vehicle on the line for some seconds; None as in `ahead`."""
        nearest = self._nearest(front, yaw)
        if nearest is None:
            return None
        if self._limits is None:
            self._limits = speed_limits(match_lanes(self._road, self._points, np.full(len(self._points), z)))
        points, limits = self._points[nearest:], self._limits[nearest:]
        return joined(points, limits, front, yaw, speed, reach_within(seconds, max(speed, float(limits[0]))))

    def _nearest(self, front: tuple[float, float], yaw: float) -> int | None:
        along = np.gradient(self._points, axis=0) @ [np.cos(yaw), np.sin(yaw)] > 0.0
        apart = np.where(along, np.hypot(*(self._points - front).T), np.inf)
        # A route may pass a place twice, as around a roundabout: the first time counts.
        close = np.flatnonzero(apart <= apart.min() + _AS_NEAR_M)
        first = close[: int(np.argmax([*(np.diff(close) > 1), True])) + 1]
        nearest = int(first[apart[first].argmin()])
        return None if apart[nearest] > _OFF_IT_M or nearest == len(apart) - 1 else nearest


REACH_S = 3.0  # length of the ego's path beyond the horizon

_CLOSED = "ryuU"  # letters of a light that stop a vehicle
_GIVES_WAY = "gm=sw"  # letters of a link on which a vehicle may have to give way
_SEEN_FROM_M = 4.5  # before a junction: default distance from which vehicles with priority are seen
_OTHERS_COME_S = 3.0  # SUMO's report of traffic with priority holds so long, if not predicted
_NEAR_JUNCTION_S = 1.5  # within this time of the junction, SUMO's current report counts
_LEAST_NEAR_M = 8.0
_SAME_M_S = 1e-6
_CHANGES_WITHIN_M = 120.0  # before the end of its lane, within which the ego changes it if its route needs that


class _Ahead(NamedTuple):
    """The lanes ahead of a vehicle on its route."""

    lanes: list[Lane]
    along_m: float  # position on the first lane
    stops: tuple[Stop, ...] = ()
    crossings: tuple[Crossing, ...] = ()
    arrives: bool = False


class SumoRoutes:
    """The routes of one simulation. `connection` is libsumo, traci, or a connection of traci."""

    def __init__(self, connection: Any, road: RoadMap) -> None:
        self._sumo, self._road = connection, road
        self._chains, self._priorities = LaneChains(road), priorities(road) or Priorities({}, {})
        self._shows: Mapping[str, Shows] = {}
        self._signed: dict[str, Lane] = {}  # lanes with the limits that they have now
        self._departed = frozenset[str]()  # departed in this step: SUMO does not yet know whom they wait for

    def begin(self, shows: Mapping[str, Shows]) -> None:
        """Begin another step of the simulation; `shows` has the predicted lights."""
        self._shows, self._departed = shows, frozenset(self._sumo.simulation.getDepartedIDList())
        self._signed.clear()

    def path(
        self, name: str, front: tuple[float, float], yaw: float, speed: float, horizon_s: float, is_ego: bool = False
    ) -> Path:
        """The path of a vehicle along its route."""
        ahead = self._ahead(name, front, yaw, speed, is_ego)
        lanes = [self._as_signed(lane) for lane in ahead.lanes]
        fastest = max([speed, *(lane.speed_limit for lane in lanes[:3])])
        reach_m = reach_within(horizon_s + (REACH_S if is_ego else 0.0), fastest)
        found = path_along(lanes, ahead.along_m, front, yaw, speed, reach_m, ahead.arrives and not is_ego)
        return replace(found, stops=ahead.stops, crossings=ahead.crossings)

    def _as_signed(self, lane: Lane) -> Lane:
        """The lane with its limit in SUMO, which the user's code may set, as variable speed signs do."""
        if lane.id not in self._signed:
            limit = float(self._sumo.lane.getMaxSpeed(lane.id))
            same = abs(limit - lane.speed_limit) < _SAME_M_S
            self._signed[lane.id] = lane if same else replace(lane, speed_limit=limit)
        return self._signed[lane.id]

    def _ahead(self, name: str, front: tuple[float, float], yaw: float, speed: float, is_ego: bool) -> _Ahead:
        vehicle = self._sumo.vehicle
        lane, along_m = vehicle.getLaneID(name), vehicle.getLanePosition(name)
        if lane not in self._road.lane:
            return _Ahead(*self._lanes_beneath(name, front, yaw))
        changed = self._changed_lane(name, lane, along_m) if is_ego else None
        if changed is not None:
            return _Ahead(*changed)
        names = [lane, *self._chains.out_of_junction(lane)]
        stops, crossings, left_m = list[Stop](), self._crossings(names, -along_m), self._length_m(names) - along_m
        for link in vehicle.getNextLinks(name):
            onward = self._chains.between(names[-1], link[0])
            waits_now = speed < STANDING_M_S and name in self._departed
            near = left_m < max(_NEAR_JUNCTION_S * speed, _LEAST_NEAR_M)
            spans = self._shut_s(names[-1], onward or (), link, near, waits_now, is_ego)
            stops += [Stop(left_m - BEFORE_LINE_M, span) for span in spans]
            if not is_ego and link[5] in _GIVES_WAY:
                stops += self._until_seen(onward or (), left_m)
            if onward is None:
                break
            crossings += self._crossings(onward, left_m, link[5] in _GIVES_WAY)
            names += onward
            left_m += self._length_m(onward)
        route = vehicle.getRoute(name)
        arrives = bool(route) and names[-1].rpartition("_")[0] == route[-1]
        lanes = self._chains.lanes(names)
        if is_ego:
            lanes = self._further(lanes)
        return _Ahead(lanes, along_m, tuple(stops), tuple(crossings), arrives)

    def _crossings(self, lanes: Sequence[str], begins_m: float, gives_way: bool = True) -> list[Crossing]:
        """The path through the junction that `lanes` begin with, if any; it begins `begins_m` [m] ahead of the front
        bumper.

        On a path in several parts, vehicles give way before the last one.
        """
        inside = self._inside(lanes)
        if not inside:
            return []
        leaves_m = begins_m + self._length_m(inside)
        return [Crossing(inside[-1], leaves_m - self._road.lane[inside[-1]].length, leaves_m, gives_way)]

    def _inside(self, lanes: Sequence[str]) -> list[str]:
        """The leading lanes that are inside a junction."""
        return list(itertools.takewhile(lambda name: self._road.lane[name].junction, lanes))

    def _until_seen(self, onward: Sequence[str], left_m: float) -> list[Stop]:
        """The line `left_m` ahead [m] towards which a vehicle without priority brakes until it sees the traffic.

        Empty where it may drive into the junction and wait there.
        """
        inside = self._inside(onward)
        seen_m = self._priorities.seen_from_m.get(inside[0], _SEEN_FROM_M) if inside else _SEEN_FROM_M
        return [] if len(inside) > 1 else [Stop(left_m - BEFORE_LINE_M, seen_m=seen_m - BEFORE_LINE_M)]

    def _shut_s(
        self, lane: str, onward: Sequence[str], link: Sequence[Any], near: bool, waits_now: bool, is_ego: bool
    ) -> list[tuple[float, float]]:
        """The times [s] at which a vehicle has to wait before the link that leads `onward` from a lane.

        It waits while its light is red, or if it is `near` and SUMO says that others come first, or will say so once it
        waits (`waits_now`). Where the right of way is known the prediction handles it, but not for all other vehicles.
        """
        is_open, state = link[2], link[5]
        spans = self._red_s(lane, onward[0] if onward else "", state)
        if near and state not in _CLOSED and (not is_open or (waits_now and state in _GIVES_WAY)):
            foreseen = not is_ego and any(one in self._priorities.links for one in self._inside(onward))
            spans.append((0.0, _OTHERS_COME_S if foreseen else np.inf))
        return spans

    def _red_s(self, lane: str, onward: str, state: str) -> list[tuple[float, float]]:
        """The times [s] at which the light between two lanes is closed; its link has the letter `state` now."""
        link = next((link for link in self._road.exits[lane] if link.target == onward), None)
        shows = self._shows.get(link.signal or "") if link is not None else None
        if link is None or shows is None:
            return [(0.0, np.inf)] if state in _CLOSED else []
        since = [since_s for since_s, _ in shows]
        spans = zip(since, [*since[1:], np.inf], shows, strict=True)
        return [(begin, end) for begin, end, (_, letters) in spans if letters[link.link] in _CLOSED]

    def _lanes_beneath(self, name: str, front: tuple[float, float], yaw: float) -> tuple[list[Lane], float]:
        """The lane under a vehicle that has no lane in SUMO, with those after it, and the position on it [m].

        SUMO gives no lane to a vehicle that was placed on another turn of a junction than its route's.
        """
        at = lane_pieces(self._road).under(np.array([front]), float(self._sumo.vehicle.getPosition3D(name)[2]))
        turn = np.abs(np.asarray(wrap(at.heading - yaw)))
        if not len(turn) or turn.min() > ALONG_RAD:
            return [], 0.0
        nearest = int(turn.argmin())
        return self._further([self._road.lanes[int(at.lane[nearest])]]), float(at.along[nearest])

    def _changed_lane(self, name: str, lane: str, along_m: float) -> tuple[list[Lane], float] | None:
        """The neighbouring lane that the route needs soon, and those after it; None where it needs none."""
        if self._road.lane[lane].junction:
            return None
        best = {one[0]: one for one in self._sumo.vehicle.getBestLanes(name)}
        own = best.get(lane)
        if own is None or own[3] == 0 or own[1] - along_m > _CHANGES_WITHIN_M:
            return None
        edge, _, number = lane.rpartition("_")
        target = f"{edge}_{int(number) + (1 if own[3] > 0 else -1)}"
        if target not in best or target not in self._road.lane:
            return None
        names = [target]
        for onward in best[target][5][1:]:
            through = self._chains.between(names[-1], onward)
            if through is None:
                break
            names += through
        share = along_m / max(self._road.lane[lane].length, 1e-3)
        return self._further(self._chains.lanes(names)), share * self._road.lane[target].length

    def _further(self, lanes: list[Lane]) -> list[Lane]:
        """Lanes extended by the straightest ones that follow, since an ego may outrun its known route."""
        return [*lanes, *lanes_ahead(self._road, lanes[-1])[1:]] if lanes else lanes

    def _length_m(self, lanes: Sequence[str]) -> float:
        return sum(self._road.lane[one].length for one in lanes)
