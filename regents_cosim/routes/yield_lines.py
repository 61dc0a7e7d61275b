"""The lanes on which others come to a place where they wait to let the ego pass.

A driver on the way with priority relies on others to wait there, as long as they can (Vienna Convention on Road Traffic
1968, art. 18). Without lights that is their line; those that turn across the ego's way on green may go on up to its
lane (art. 16(1)(b)). Other lines with lights are left out, as what they ask for changes.
"""

from collections.abc import Iterator, Mapping
from functools import lru_cache

import numpy as np
import shapely

from regents_cosim.maps.roadmap import Connection, Lane, RoadMap
from regents_cosim.routes.give_way import WayMet, light_into, waits_by_lights, ways_met
from regents_cosim.routes.route import route_of
from regents_cosim.scenario.scenario import Scenario, Signal

_REACH_M = 100.0  # back from a line: more than a car at 25 m/s needs to stop gently


def yield_lines(scenario: Scenario) -> Mapping[str, float]:
    """By id of the lanes that lead to a line, the distance [m] from their end to the nearest one; negative before it.

    A lane that also leads to where the ego has to wait, or where the map does not tell, is left out.
    """
    return _lines(scenario.road, tuple(one.lane for one in route_of(scenario).lanes), scenario.signals)


@lru_cache(maxsize=64)
def _lines(road: RoadMap, lanes: tuple[str, ...], signals: tuple[Signal, ...]) -> Mapping[str, float]:
    waiting = dict[str, list[float | None]]()
    for one in ways_met(road, lanes):
        waiting.setdefault(one.other, []).append(_waits_at(road, one, signals))
    found, relied_on = dict[str, float](), dict[str, bool]()
    for name, places in waiting.items():
        known = [place for place in places if place is not None]
        into = min(known, default=0.0)
        own = [(road.lane[name], -road.lane[name].length)] if into else []
        for lane, beyond in (*own, *_upstream(road, name, {*lanes, *waiting})):
            found[lane.id] = min(beyond + into, found.get(lane.id, beyond + into))
            relied_on[lane.id] = len(known) == len(places) and relied_on.get(lane.id, True)
    return {lane: beyond for lane, beyond in found.items() if relied_on[lane]}


def _waits_at(road: RoadMap, met: WayMet, signals: tuple[Signal, ...]) -> float | None:
    """How far into their lane others wait for the ego [m]: 0 for a line before it; None where they may not wait."""
    if met.they_yield is not True or met.ego_yields is not False:
        return None
    mine, theirs = light_into(road, met.lane), light_into(road, met.other)
    if mine is None and theirs is None:
        return 0.0
    if mine is None or theirs is None or not _green_but_waits(mine, theirs, signals):
        return None
    lane, other = road.lane[met.lane], road.lane[met.other]
    inside = other.line.intersection(lane.line.buffer(0.5 * lane.width, cap_style="flat"))
    corners = shapely.points(shapely.get_coordinates(inside))
    return None if inside.is_empty else float(np.min(shapely.line_locate_point(other.line, corners)))


def _green_but_waits(mine: Connection, theirs: Connection, signals: tuple[Signal, ...]) -> bool:
    """Whether others have green at some time, and the lights never let them go before the ego."""
    changes = next((one.changes for one in signals if one.id == mine.signal == theirs.signal), ())
    green = any(letters[theirs.link : theirs.link + 1] in ("g", "G") for _, letters in changes)
    return green and all(waits_by_lights(mine, theirs, signals, step) != "first" for step, _ in changes)


def _upstream(road: RoadMap, name: str, without: set[str]) -> Iterator[tuple[Lane, float]]:
    """The lanes that lead to the begin of another, each with the distance [m] from its end to there."""
    reached, waiting = set[str](), [(name, 0.0)]
    while waiting:
        after, beyond = waiting.pop(0)
        for link in road.entries[after]:
            if link.source in without or link.source in reached:
                continue
            reached.add(link.source)
            lane = road.lane[link.source]
            yield lane, beyond
            if beyond + lane.length < _REACH_M:
                waiting.append((lane.id, beyond + lane.length))
