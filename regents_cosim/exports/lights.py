"""Traffic lights in a form that export formats need: by the lane at whose end they stand, with their phases."""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from regents_cosim.geometry.frames import wrap
from regents_cosim.geometry.lines import end_heading
from regents_cosim.maps.roadmap import Connection, Lane, RoadMap
from regents_cosim.plain_text import listed
from regents_cosim.scenario.scenario import Scenario, Signal

_STRAIGHT_RAD = np.deg2rad(30.0)
_NAMED = 5  # most lights named in a message


@dataclass(frozen=True)
class Light:
    """Links of a signal that show the same letters at all times."""

    signal: str
    links: tuple[int, ...]
    at: str  # the lane or crossing where it stands
    ways: frozenset[str]  # the directions "left", "straight", "right" that it controls; empty: the whole lane
    phases: tuple[tuple[int, str], ...]  # durations [steps] and letters, in order


def lights_of(road: RoadMap, signals: Sequence[Signal], steps: int) -> Iterator[Light]:
    """Every light with a place and its phases in `steps` steps: those of lanes, then those of crossings."""
    shown = {signal.id: signal for signal in signals}
    for lane in road.lanes:
        yield from _of_lane(lane, road, shown, steps)
    for one in road.walkways:
        if one.kind == "crossing" and one.signal in shown and one.link < len(shown[one.signal].letters(0)):
            phases = _phases(shown[one.signal], one.link, steps)
            yield Light(one.signal, (one.link,), one.id, frozenset(), phases)


def without_place(scenario: Scenario, placed: Iterable[tuple[str, int]]) -> list[str]:
    """Messages about lights that the format has no place for; `placed` are the links (signal, index) that it has."""
    placed = set(placed)
    has = {signal for signal, _ in placed}
    lost = sorted({signal.id for signal in scenario.signals} - has)
    said = [f"traffic light{'s' * (len(lost) > 1)} left out: {listed(lost, _NAMED)}"] if lost else []
    crossings = [(one.signal, one.link) for one in scenario.road.walkways if one.kind == "crossing"]
    dark = sorted(f"{signal} {link}" for signal, link in crossings if signal in has and (signal, link) not in placed)
    return said + ([f"traffic lights of crossings left out: {listed(dark, _NAMED)}"] if dark else [])


def _of_lane(lane: Lane, road: RoadMap, shown: dict[str, Signal], steps: int) -> Iterator[Light]:
    same = dict[tuple[str, tuple[tuple[int, str], ...]], list[Connection]]()
    for link in road.exits[lane.id]:
        signal = shown.get(link.signal or "")
        if signal is not None and link.link < len(signal.letters(0)):
            same.setdefault((signal.id, _phases(signal, link.link, steps)), []).append(link)
    for (signal_id, phases), links in same.items():
        ways = frozenset(_way(lane, road.lane[link.target]) for link in links) if len(same) > 1 else frozenset[str]()
        yield Light(signal_id, tuple(sorted({link.link for link in links})), lane.id, ways, phases)


def _phases(signal: Signal, link: int, steps: int) -> tuple[tuple[int, str], ...]:
    shown = ((count, letters[link]) for count, letters in signal.phases(steps))
    by_letter = itertools.groupby(shown, key=lambda phase: phase[1])
    return tuple((sum(count for count, _ in same), letter) for letter, same in by_letter)


def _way(lane: Lane, after: Lane) -> str:
    """The direction from one lane to the next, by the angle of the path through the junction."""
    turn = wrap(end_heading(after.centre) - end_heading(lane.centre))
    return "straight" if abs(turn) < _STRAIGHT_RAD else "left" if turn > 0 else "right"
