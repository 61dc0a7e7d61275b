"""The ego's route: its logged path, extended along the lanes, as one evenly spaced line."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.geometry.frames import wrap
from regents_cosim.geometry.lines import end_heading, evenly, straight_on
from regents_cosim.maps.roadmap import Connection, Lane, RoadMap
from regents_cosim.routes.lane_matching import match_lanes
from regents_cosim.scenario.scenario import Scenario, Tracks

SPACING_M = 1.0
EXTENSION_M = 120.0  # beyond the logged path: a planner may drive faster than the log
LONGEST_M = 400.0  # longest extension along lanes: those of highway-env are kilometres long
_MIN_STEP_M = 0.5  # an ego that stands adds no points


@lru_cache(maxsize=16)  # the planner, the verdicts and the tags of a case all ask for it
def logged_way(scenario: Scenario) -> Float[np.ndarray, "point 2"]:
    """The ego's logged path, extended along connected lanes: a line [m] with a point every `SPACING_M`."""
    logged = logged_path(scenario.recorded_tracks)
    lanes = lanes_ahead(scenario.road, lanes_under(scenario, 0, logged)[-1])
    return evenly(straight_on(_along(logged, lanes), EXTENSION_M - SPACING_M), SPACING_M)


def lanes_under(scenario: Scenario, agent: int, points: Float[np.ndarray, "point 2"]) -> list[Lane | None]:
    """The lane under each point [m] of an agent's path, on the agent's level; None where there is none."""
    return match_lanes(scenario.road, points, scenario.heights.of(agent, *points.T))


def logged_path(tracks: Tracks, agent: int = 0) -> Float[np.ndarray, "point 2"]:
    """An agent's positions [m] without repeated ones, at least two; the agent must be valid at some step."""
    there = tracks.valid[agent]
    positions = np.stack([tracks.x[agent, there], tracks.y[agent, there]], axis=1)
    kept = [positions[0]]
    for position in positions[1:]:
        if np.hypot(*(position - kept[-1])) >= _MIN_STEP_M:
            kept.append(position)
    if len(kept) == 1:
        yaw = tracks.yaw[agent, there][-1]
        kept.append(kept[0] + _MIN_STEP_M * np.array([np.cos(yaw), np.sin(yaw)]))
    return np.array(kept)


def _along(logged: Float[np.ndarray, "point 2"], lanes: list[Lane]) -> Float[np.ndarray, "further 2"]:
    """The logged path, extended along `lanes`."""
    points, end = [], logged[-1]
    for lane in lanes:
        line = lane.line
        since = line.project(shapely.Point(end)) if lane is lanes[0] else 0.0
        since += 5.0 if lane is lanes[0] else 0.0
        along = np.arange(since, min(line.length, since + LONGEST_M - SPACING_M * len(points)), SPACING_M)
        points.extend(shapely.get_coordinates(shapely.line_interpolate_point(line, along)))
    return np.array([*logged, *points])


def lanes_ahead(road: RoadMap, lane: Lane | None, reach_m: float = 2.0 * EXTENSION_M) -> list[Lane]:
    """`lane` and its successors, the straightest at each fork, up to a total length of `reach_m`."""
    found, length = [], 0.0
    while lane is not None and lane not in found and length < reach_m:
        found.append(lane)
        length += lane.length
        lane = straightest(lane, [road.lane[link.target] for link in road.exits[lane.id]])
    return found


def straightest(lane: Lane, onward: Sequence[Lane]) -> Lane | None:
    """The lane of `onward` that ends in the direction most like that of `lane`; None where there is none."""
    out = end_heading(lane.centre)
    return min(onward, key=lambda to: abs(wrap(end_heading(to.centre) - out)), default=None)


def speed_limits(on_lane: list[Lane | None]) -> Float[np.ndarray, " point"]:
    """Speed limit [m/s] at every point; a point without a lane takes the limit of the nearest point that has one."""
    limits = np.array([np.nan if lane is None else lane.speed_limit for lane in on_lane])
    known = np.flatnonzero(np.isfinite(limits))
    if not len(known):
        return np.full(len(on_lane), np.inf)
    nearest = np.abs(np.arange(len(on_lane))[:, None] - known).argmin(axis=1)
    return limits[known[nearest]]


def link_between(road: RoadMap, before: Lane | None, after: Lane | None) -> Connection | None:
    """The connection from one lane into another; None without one."""
    if before is None or after is None or before is after:
        return None
    return next((link for link in road.exits[before.id] if link.target == after.id), None)
