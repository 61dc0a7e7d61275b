"""The way of a log: how long it is, and the room that vehicles have beside it on lanes of their direction."""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from regents_cosim.geometry.lines import distances_along
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.mirror.actions import fill_gaps
from regents_cosim.mirror.programs.on_device import on_device
from regents_cosim.routes.lane_matching import lanes_at
from regents_cosim.scenario.scenario import VEHICLE_KINDS, Scenario

_EVERY = 5  # steps: the room changes little in between


class LoggedWay(eqx.Module):
    """The logged way of each agent; the room beside it is 0 where the map does not tell, or the agent is no vehicle."""

    driven: Float[Array, "agent time"]  # [m] since the first step
    to_left_lane: Float[Array, "agent time"]  # [m] to the centre of the lane on its left; 0: there is none
    to_right_lane: Float[Array, "agent time"]  # [m] to the right, positive
    left: Float[Array, "agent time"]  # [m] by which the body may move to the left
    right: Float[Array, "agent time"]  # [m] to the right, positive


def logged_way(scenario: Scenario, padded: int) -> LoggedWay:
    """The ways of all agents of a scenario, with rows for `padded` agents."""
    vehicles = np.array([agent.kind in VEHICLE_KINDS for agent in scenario.agents])
    tracks, steps = fill_gaps(scenario.tracks), np.arange(0, scenario.tracks.steps, _EVERY)
    sampled = np.ix_(np.flatnonzero(vehicles), steps)
    points = np.stack([tracks.x[sampled], tracks.y[sampled]], axis=-1).reshape(-1, 2)
    near = lanes_at(scenario.road, points, tracks.z[sampled].ravel(), tracks.yaw[sampled].ravel())
    room = np.zeros((4, padded, tracks.steps))
    room_sampled = np.array([_beside(scenario.road, options) for options in near]).T.reshape(4, -1, len(steps))
    half_width = np.array([0.5 * agent.width for agent in scenario.agents])[vehicles]
    on_lane = room_sampled[2:].any(axis=0)
    room_sampled[2:] = np.where(on_lane, np.maximum(room_sampled[2:] - half_width[:, None], 0.0), 0.0)
    room[:, np.flatnonzero(vehicles)] = np.repeat(room_sampled, _EVERY, axis=2)[..., : tracks.steps]
    driven = distances_along(tracks.x, tracks.y)
    driven = np.pad(driven, ((0, padded - len(driven)), (0, 0)))
    return LoggedWay(*(on_device(values, np.float32) for values in (driven, *room)))


def _beside(road: RoadMap, near: list[tuple[Lane, float]]) -> tuple[float, float, float, float]:
    """The distances [m] to the lanes on the left and right of a place, and to the outer edges of these lanes."""
    if not near:
        return 0.0, 0.0, 0.0, 0.0
    lane, off = min(near, key=lambda option: abs(option[1]))
    to_lane, to_edge = [], []
    for neighbour, toward in ((lane.left, -off), (lane.right, off)):
        width = road.lane[neighbour].width if neighbour else 0.0
        to_lane.append(max(0.5 * (lane.width + width) + toward, 0.0) if neighbour else 0.0)
        to_edge.append(0.5 * lane.width + width + toward)
    return to_lane[0], to_lane[1], to_edge[0], to_edge[1]
