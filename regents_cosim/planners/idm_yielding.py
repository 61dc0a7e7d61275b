"""IDM that gives way: it stops before the ways of others that have priority while one of them is about to pass.

Where the map says that the ego gives way (`Route.meetings`), the time in which a road user on the other way passes, at
its present speed, is held against the time in which the ego would pass. Where less time lies between both than drivers
accept (the post-encroachment time), the place counts as a red light for `IDM`.

Source: Allen, Shin and Cooper 1978, Analysis of traffic conflicts and collisions, for the post-encroachment time.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import shapely
from jaxtyping import Array, Bool, Float

from regents_cosim.geometry.frames import ahead_and_left
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.mirror.bicycle import ControlArrays, Motion, wrap
from regents_cosim.mirror.programs.on_device import on_device, seen_from
from regents_cosim.mirror.rollout import Traffic
from regents_cosim.planners.idm import IDM, IdmMemory, IdmSight, place_on_route
from regents_cosim.planners.jax_planner import CompiledScene, JaxPlanner
from regents_cosim.routes.give_way import Meeting
from regents_cosim.routes.route import Route, route_into_gaps
from regents_cosim.scenario.scenario import Scenario

_MEETINGS = 8  # kept: the first ones of the route
_POINTS, _SPACING_M = 32, 3.0  # of the way of others up to where it is crossed
_BESIDE_M = 2.0  # this far aside, a road user is on that way ...
_TURNED_RAD = 1.0  # ... if it is turned from it by less than this
_APART_S = 1.5  # between the ego's passing and that of others
_STOP_M = 1.0  # before the other way
_WAITS_M_S = 1.0  # slower, another does not claim its way
_LEAST_SPEED_M_S = 3.0  # of the ego, which drives on
_FAR_M = 1e3


class PriorityWays(eqx.Module):
    """The ways that the ego gives way to, up to where its route meets them."""

    begin: Float[Array, " meeting"]  # [m] along the route, where the other way is reached
    end: Float[Array, " meeting"]  # [m] and where it is left behind
    x: Float[Array, "meeting point"]  # [m] of the other way, the last point in the middle of the meeting
    y: Float[Array, "meeting point"]  # [m]
    yaw: Float[Array, "meeting point"]  # [rad]
    holds: Bool[Array, "time meeting"]  # whether the ego gives way to them, under the lights of that step


class YieldingMemory(eqx.Module):
    """IDM's memory, and the ways with priority."""

    idm: IdmMemory
    ways: PriorityWays


class YieldingSight(eqx.Module):
    """The others as IDM sees them, and in full."""

    idm: IdmSight
    traffic: Traffic


class YieldingIDM(JaxPlanner):
    """IDM that gives way where the map has it."""

    idm: IDM = IDM()

    def init(self, scene: CompiledScene) -> YieldingMemory:
        """The route, and the ways that have priority over it."""
        ways = _priority_ways(route_into_gaps(scene.scenario), scene.scenario, scene.origin)
        return YieldingMemory(self.idm.init(scene), ways)

    def look(self, memory: YieldingMemory, traffic: Traffic) -> YieldingSight:
        """Every agent, on the route and in full."""
        return YieldingSight(self.idm.look(memory.idm, traffic), super().look(memory, traffic))

    def step(self, memory: YieldingMemory, sight: YieldingSight, ego: Motion) -> tuple[ControlArrays, YieldingMemory]:
        """IDM's controls, with a red light before each way on which another has to be let pass."""
        idm, ways = memory.idm, memory.ways
        along, _, _ = place_on_route(idm, ego.x, ego.y)
        claimed = ways.holds[idm.now] & _claimed(ways, sight.traffic, along, idm.half_length, ego.speed)
        lines = jnp.concatenate([idm.line, ways.begin - _STOP_M])
        closed = jnp.concatenate([idm.closed[idm.now], claimed])[None]
        today = eqx.tree_at(lambda m: (m.line, m.closed, m.now), idm, (lines, closed, jnp.zeros_like(idm.now)))
        controls, _ = self.idm.step(today, sight.idm, ego)
        return controls, eqx.tree_at(lambda m: m.idm.now, memory, idm.now + 1)


def _claimed(
    ways: PriorityWays, traffic: Traffic, along: Array, half_length: Array, speed: Array
) -> Bool[Array, " meeting"]:
    """Whether another with priority would pass too shortly before or after the ego."""
    motion = traffic.motion
    away = jnp.hypot(ways.x[..., None] - motion.x, ways.y[..., None] - motion.y)
    nearest = away.argmin(axis=1)  # [meeting, agent]
    yaw = jnp.take_along_axis(ways.yaw, nearest, axis=1)
    x, y = (jnp.take_along_axis(values, nearest, axis=1) for values in (ways.x, ways.y))
    ahead, aside = ahead_and_left(jnp, motion.x - x, motion.y - y, yaw)
    to_middle = (_POINTS - 1 - nearest) * _SPACING_M - ahead
    there = (jnp.abs(aside) < _BESIDE_M) & (jnp.abs(wrap(motion.yaw - yaw)) < _TURNED_RAD) & traffic.valid
    reach = 0.5 * (ways.end - ways.begin)[:, None] + traffic.half_length
    there &= (to_middle > -reach) & (motion.speed > _WAITS_M_S)
    pace = jnp.maximum(motion.speed, _WAITS_M_S)
    comes_s, gone_s = (to_middle - reach) / pace, (to_middle + reach) / pace
    own = jnp.maximum(speed, _LEAST_SPEED_M_S)
    enters_s = ((ways.begin - along - half_length) / own)[:, None]
    leaves_s = ((ways.end - along + half_length) / own)[:, None]
    conflict = there & (comes_s < leaves_s + _APART_S) & (gone_s > enters_s - _APART_S)
    return conflict.any(axis=1) & (ways.begin > along + half_length - _STOP_M)


def _priority_ways(route: Route, scenario: Scenario, origin: Float[np.ndarray, " 2"]) -> PriorityWays:
    kept = [one for one in route.meetings if one.ego_yields and one.kind != "pedestrians"][:_MEETINGS]
    begin, end = (np.full(_MEETINGS, value) for value in (-_FAR_M, -_FAR_M))
    points = np.zeros((_MEETINGS, _POINTS, 2))
    yaw = np.zeros((_MEETINGS, _POINTS))
    holds = np.zeros((scenario.tracks.steps, _MEETINGS), bool)
    for index, one in enumerate(kept):
        begin[index], end[index] = one.begin_m, one.end_m
        holds[:, index] = [one.under(scenario.signals, step).ego_yields for step in range(len(holds))]
        way, yaw[index] = _way_to(route, scenario.road, one)
        points[index] = seen_from(way, origin)
    return PriorityWays(
        *(on_device(values, np.float32) for values in (begin, end, points[..., 0], points[..., 1], yaw)),
        holds=on_device(holds, np.bool_),
    )


def _way_to(
    route: Route, road: RoadMap, meeting: Meeting
) -> tuple[Float[np.ndarray, "point 2"], Float[np.ndarray, " point"]]:
    """The way of the others up to the middle of the meeting; straight back where the map begins.

    A point [m, map frame] every `_SPACING_M`, and the yaw [rad] there.
    """
    middle = route.at(0.5 * (meeting.begin_m + meeting.end_m))
    line = shapely.LineString(_before(road, road.lane[meeting.other]))
    until = float(shapely.line_locate_point(line, shapely.points(middle.x, middle.y)))
    along = until - _SPACING_M * np.arange(_POINTS)[::-1]
    points = shapely.get_coordinates(line.interpolate(np.clip(along, 0.0, None)))
    next_points = shapely.get_coordinates(line.interpolate(np.clip(along, 0.0, None) + 0.5))
    direction = np.diff(np.stack([points, next_points]), axis=0)[0]
    direction[np.hypot(*direction.T) < 1e-6] = points[-1] - points[-2]
    yaw = np.arctan2(direction[:, 1], direction[:, 0])
    back = np.minimum(along, 0.0)[:, None] * np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    return points + back, yaw


def _before(road: RoadMap, lane: Lane) -> Float[np.ndarray, "point 2"]:
    """The centre line [m] of a lane with those that lead into it, at each step the first."""
    parts, length, seen = [lane.centre], 0.0, {lane.id}
    while length < _POINTS * _SPACING_M:
        lane = next((road.lane[link.source] for link in road.entries[lane.id]), lane)
        if lane.id in seen:
            break
        seen.add(lane.id)
        parts.append(lane.centre)
        length += lane.length
    return np.concatenate(parts[::-1])
