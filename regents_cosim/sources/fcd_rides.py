"""Finds persons who ride in a vehicle that an fcd-output does not contain.

By default a log does not say that a person rides: it puts the person where the vehicle is. Where the log holds only a
share of the vehicles, a passenger of a missing vehicle looks like a pedestrian who walks along a lane at 50 km/h.
"""

import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely

from regents_cosim.checks.bounded import open_bounded
from regents_cosim.checks.xml_input import unpacked_limit
from regents_cosim.geometry.frames import wrap
from regents_cosim.geometry.lines import heading_near
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.simulators.sumo.options import is_on

ALL_OF_A_CASE = " all road users of a case of regents_cosim "  # the comment in a log that this package writes
_RUNS_MPS = 5.5  # no pedestrian is faster
_RIDES_S = 3.0  # shortest ride at lower speeds: bends of walks lie on lanes by chance
_LEAST_S = 1e-3
_SPEEDS_UP_M_S2 = 2.6  # assumed acceleration where the log has no speeds
_JUMP_M = 0.3  # beyond what the speed explains: the person gets in or out, or the vehicle changes lanes
_ON_CENTRE_M = 0.5  # from the centre of a lane: vehicles drive there, persons walk along the border
_ALONG_RAD = np.deg2rad(20.0)
_HEAD_BYTES = 1 << 16
_COMMENT = re.compile(rb"<!--(.*?)(-->|\Z)", re.DOTALL)
_OPTION = re.compile(rb'<([\w.-]+)\s+value="([^"]*)"')


class _Seen(NamedTuple):
    """A person at one instant."""

    time_s: float
    x: float  # [m]
    y: float  # [m]
    angle: float  # degrees clockwise from north
    speed: float  # [m/s]


@dataclass(slots=True)
class _Stretch:
    """A piece of one person's motion without getting in or out."""

    first: _Seen
    fastest: _Seen
    last: _Seen


@dataclass
class RidingPersons:
    """When persons ride, judged by their motion: call `see` for all states in the order of time, then ask `at`."""

    road: RoadMap
    _now: dict[str, _Stretch] = field(default_factory=dict)
    _found: dict[str, list[tuple[float, float]]] = field(default_factory=dict)

    def see(self, name: str, time_s: float, x: float, y: float, angle: float, speed: float | None) -> None:
        """Add a state of a person who may be on foot [m, degrees clockwise from north, m/s where the log has it]."""
        known = self._now.get(name)
        if known is None:
            now = _Seen(time_s, x, y, angle, speed or 0.0)
            self._now[name] = _Stretch(now, now, now)
            return
        before = known.last
        dt, dx, dy = time_s - before.time_s, x - before.x, y - before.y
        if speed is None:
            most_m = before.speed * dt + _JUMP_M + _SPEEDS_UP_M_S2 * dt * dt
        else:
            most_m = (speed if speed > before.speed else before.speed) * dt + _JUMP_M
        if dx * dx + dy * dy > most_m * most_m:
            now = _Seen(time_s, x, y, angle, speed or 0.0)
            if not (self._aboard(before) and self._aboard(now)):
                self._close(name)
                self._now[name] = _Stretch(now, now, now)
                return
        if speed is None:
            speed = math.hypot(dx, dy) / max(dt, _LEAST_S)
        known.last = _Seen(time_s, x, y, angle, speed)
        if speed > known.fastest.speed:
            known.fastest = known.last

    def finish(self) -> None:
        """Close the last pieces, once all states were seen."""
        for name in list(self._now):
            self._close(name)

    def at(self, name: str, time_s: float) -> bool:
        """Whether a person rides at a time that was seen."""
        return any(begin_s <= time_s <= end_s for begin_s, end_s in self._found.get(name, ()))

    @property
    def number(self) -> int:
        """The number of persons who ride at some time."""
        return len(self._found)

    def _close(self, name: str) -> None:
        done = self._now.pop(name)
        begin_s, end_s = done.first.time_s, done.last.time_s
        is_slow_ride = end_s - begin_s > _RIDES_S and all(map(self._aboard, (done.first, done.fastest, done.last)))
        if is_slow_ride or done.fastest.speed > _RUNS_MPS:
            self._found.setdefault(name, []).append((begin_s, end_s))

    def _aboard(self, seen: _Seen) -> bool:
        """Whether a person is where a vehicle would be: on the centre of a lane, facing along it."""
        point = shapely.Point(seen.x, seen.y)
        lines = self.road.centre_lines
        near = lines.geometries[lines.query(point, predicate="dwithin", distance=_ON_CENTRE_M)]
        yaw = math.radians(90.0 - seen.angle)
        return any(abs(wrap(heading_near(line, point) - yaw)) < _ALONG_RAD for line in near)


def what_it_lacks(log: Path) -> str | None:
    """The options that kept road users out of an fcd-output; empty if there were none, None if it does not say."""
    options = _written_with(log)
    if options is None:
        return None
    return ", ".join(f"{name} {value[:40]}" for name, value in options.items() if _restricts(name, value))


def is_mesoscopic(log: Path) -> bool:
    """Whether an fcd-output says that it comes from a mesoscopic simulation."""
    return is_on((_written_with(log) or {}).get("mesosim", ""))


def _written_with(log: Path) -> dict[str, str] | None:
    """The options in the configuration that SUMO writes at the top of an fcd-output; None where there is none.

    A log that this package wrote was restricted by no option.
    """
    with open_bounded(log, unpacked_limit(log)) as stream:
        head = stream.read(_HEAD_BYTES)
    comment = _COMMENT.search(head)
    if comment is not None and ALL_OF_A_CASE.encode() in comment[1]:
        return {}
    if comment is None or b"onfiguration" not in comment[1]:
        return None
    return {name.decode(): value.decode("utf-8", "replace") for name, value in _OPTION.findall(comment[1])}


def _restricts(name: str, value: str) -> bool:
    if name in ("device.fcd.probability", "person-device.fcd.probability"):
        try:
            return 0.0 <= float(value) < 1.0
        except ValueError:
            return True
    return bool(value) and name in (
        "device.fcd.explicit",
        "person-device.fcd.explicit",
        "fcd-output.filter-edges.input-file",
        "fcd-output.filter-shapes",
        "person-fcd-output",
    )
