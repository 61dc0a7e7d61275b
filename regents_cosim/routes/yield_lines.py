"""The lanes on which others come to a line where they have to let the ego pass.

A driver on the way with priority relies on others to wait there, as long as they can (Vienna Convention on Road Traffic
1968, art. 18). Lines with lights are left out, as what they ask for changes.
"""

from collections.abc import Iterator, Mapping
from functools import lru_cache

from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.routes.give_way import are_lit, ways_met
from regents_cosim.routes.route import route_of
from regents_cosim.scenario.scenario import Scenario

_REACH_M = 100.0  # back from a line: more than a car at 25 m/s needs to stop gently


def yield_lines(scenario: Scenario) -> Mapping[str, float]:
    """By id of the lanes that lead to a line, the distance [m] from their end to the nearest one.

    A lane that also leads to where the ego has to wait, or where the map does not tell, is left out.
    """
    return _lines(scenario.road, tuple(one.lane for one in route_of(scenario).lanes))


@lru_cache(maxsize=64)
def _lines(road: RoadMap, lanes: tuple[str, ...]) -> Mapping[str, float]:
    met = dict[str, bool]()
    for one in ways_met(road, lanes):
        they_wait = one.they_yield is True and one.ego_yields is False and not are_lit(road, one.lane, one.other)
        met[one.other] = met.get(one.other, True) and they_wait
    found, relied_on = dict[str, float](), dict[str, bool]()
    for name, waits in met.items():
        for lane, beyond in _upstream(road, name, {*lanes, *met}):
            found[lane.id] = min(beyond, found.get(lane.id, beyond))
            relied_on[lane.id] = waits and relied_on.get(lane.id, True)
    return {lane: beyond for lane, beyond in found.items() if relied_on[lane]}


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
