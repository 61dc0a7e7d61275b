"""Cheap check of whether a vehicle could meet the ego on a lawful path in time, made before its drives are computed.

It uses the least and the greatest distance that a vehicle gets along a path lawfully. The bounds are loose, so that few
drives are lost.
"""

import itertools
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import shapely
from jaxtyping import Bool, Float

from regents_cosim.attacks.starts.meeting import MeetingPair
from regents_cosim.attacks.starts.reachable import travelled
from regents_cosim.geometry.lines import evenly
from regents_cosim.norms.limits import OVER_LIMIT
from regents_cosim.scenario.scenario import Scenario, Tracks
from regents_cosim.verdicts.law.lawful_ways import LawfulWay, ways_ahead
from regents_cosim.verdicts.ordinary import DrivingLimits

_BESIDE_M = 0.5  # between two bodies that meet, since paths are smoothed later
_ROUNDED_M = 2.0  # along a path, for the same reason
_SPACING_M = 1.0


def near_enough(
    scenario: Scenario, ego: Tracks, earliest_s: float, limits: Mapping[str, DrivingLimits]
) -> Bool[np.ndarray, " agent"]:
    """Whether each agent could be where the ego [1, time] is, from `earliest_s` on, if it could drive there straight.

    `limits` are the driving limits of each kind.
    """
    tracks, seconds = scenario.tracks, np.arange(ego.steps) * scenario.dt
    accel = np.array([limits[one.kind].accel if one.kind in limits else 0.0 for one in scenario.agents])
    half_m = np.array([0.5 * np.hypot(one.length, one.width) for one in scenario.agents])
    away = np.hypot(tracks.x[:, :1] - ego.x, tracks.y[:, :1] - ego.y)
    most = tracks.speed[:, :1] * seconds + 0.5 * accel[:, None] * seconds**2
    there = away < most + (half_m + half_m[0] + _BESIDE_M)[:, None]
    return (there & (seconds >= earliest_s)).any(axis=1)


def could_meet(scenario: Scenario, agent: int, ego: Tracks, earliest_s: float, limits: DrivingLimits) -> bool:
    """Whether the agent could touch the ego [1, time] on one of its lawful paths, with at most one lane change.

    `limits` are its driving limits. Contacts before `earliest_s` do not count. An agent without paths is checked on its
    own track, at any time.
    """
    beside_m = 0.5 * (scenario.ego.width + scenario.agents[agent].width) + _BESIDE_M
    ways = [way for way in ways_ahead(scenario, agent) if way.changes <= 1 and len(way.points) > 1]
    tracks = scenario.tracks
    points = [way.points for way in ways] or [np.stack([tracks.x[agent], tracks.y[agent]], axis=1)]
    own = shapely.LineString(np.stack([ego.x[0], ego.y[0]], axis=1))
    near = shapely.dwithin([shapely.LineString(one) for one in points], own, beside_m)
    if not ways or not near.any():
        return bool(near.any())
    pair = MeetingPair.of(scenario, agent, ego)
    wider = replace(pair, mine=(pair.mine[0] + 2.0 * _BESIDE_M, pair.mine[1] + 2.0 * _BESIDE_M))
    seconds = np.arange(len(pair.there)) * scenario.dt
    late = pair.first * scenario.dt + seconds >= earliest_s
    speed = tracks.speed[agent, pair.first :]
    for way in itertools.compress(ways, near):
        line = evenly(way.points, _SPACING_M)
        if len(line) > 1:
            ahead = np.gradient(line, axis=0)
            touches = wider.touch(line[:, :1], line[:, 1:], np.arctan2(ahead[:, 1:], ahead[:, :1]))
            if np.any(touches & _gets_to(way, len(line), speed, seconds, limits) & late):
                return True
    return False


def _gets_to(
    way: LawfulWay,
    places: int,
    logged: Float[np.ndarray, " time"],
    seconds: Float[np.ndarray, " time"],
    limits: DrivingLimits,
) -> Bool[np.ndarray, "place time"]:
    """Whether a vehicle with the first `logged` speed [m/s] can have reached each of the `places`, one metre apart."""
    speed = float(logged[0])
    fastest = max(float(logged.max()), OVER_LIMIT * max(lane.speed_limit for lane in way.lanes))
    least, most = travelled(seconds, speed, fastest, limits.accel, limits.braking)
    along = np.arange(places)[:, None] * _SPACING_M
    return (along > least - _ROUNDED_M) & (along < most + _ROUNDED_M)
