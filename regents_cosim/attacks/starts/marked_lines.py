"""Lines of a candidate, with the places and times marked at which it would touch the ego.

This is the path-time space of Kant and Zucker 1986: distance along the line, and time.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from regents_cosim.attacks.starts.drive_lines import SPACING_M, ContactRange, DriveLine, lines_ahead
from regents_cosim.attacks.starts.meeting import MeetingPair
from regents_cosim.attacks.starts.reachable import Reachable
from regents_cosim.attacks.starts.walked_lines import walked_lines
from regents_cosim.norms.limits import MOST_SPEED_M_S, OVER_LIMIT
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.verdicts.ordinary import DrivingLimits


class MarkedLine(NamedTuple):
    """A line, with the points at which the candidate would touch the ego at each step."""

    line: DriveLine
    touched: Bool[np.ndarray, "point time"]


def marked_lines(
    scenario: Scenario,
    agent: int,
    pair: MeetingPair,
    begun: tuple[float, float],
    limits: DrivingLimits,
    earliest_s: float,
    most_lines: int | None = None,
) -> list[MarkedLine]:
    """Marked lines of a vehicle that enters with speed and acceleration `begun` [m/s, m/s^2], from `earliest_s` on.

    It drives no faster than an attack lets its kind drive. If `most_lines` is given, only the first lines are drawn.
    """
    logged, seconds = float(scenario.tracks.speed[agent].max()), np.arange(len(pair.there)) * scenario.dt
    reachable, earliest_s = Reachable(*begun, logged, limits, seconds), earliest_s - pair.first * scenario.dt
    begin = float(scenario.tracks.x[agent, pair.first]), float(scenario.tracks.y[agent, pair.first])
    near = reachable.near(pair, scenario.road, begin, earliest_s)
    most = MOST_SPEED_M_S.get(scenario.agents[agent].kind, np.inf) / OVER_LIMIT
    lines = islice(lines_ahead(scenario, agent, near), most_lines) if near else ()
    # The log takes one of the ways, and ways that part later share lane changes: each line counts once.
    slow = (replace(line, limit=min(line.limit, most)) for line in {line.key: line for line in lines}.values())
    return _marked(MarkedLine(line, _shown(line, reachable.touched(line, pair, earliest_s))) for line in slow)


def _shown(line: DriveLine, touched: Bool[np.ndarray, "point time"]) -> Bool[np.ndarray, "point time"]:
    """The touched points from where a lane change shows on; drives without the change cover those before."""
    return touched & (np.arange(len(touched)) >= line.shows_m / SPACING_M)[:, None]


def marked_walked_lines(scenario: Scenario, agent: int, pair: MeetingPair, lawful: bool) -> list[MarkedLine]:
    """The marked lines of a pedestrian, at any time, because it cuts the corners of its lines."""
    lines = walked_lines(scenario, agent, ContactRange.to(pair.own[0], pair.own[1], pair.reach_m), lawful)
    return _marked(
        MarkedLine(one, pair.touch(one.points[:, :1], one.points[:, 1:], one.heading[:, None])) for one in lines
    )


def _marked(lines: Iterator[MarkedLine]) -> list[MarkedLine]:
    return [one for one in lines if one.touched.any()]
