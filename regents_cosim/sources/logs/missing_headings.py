"""Finds the headings of road users where a log has none, by one rule for all formats.

A road user that moves faces along its motion, and keeps the last or the next direction while it stands. One that never
moves faces along the lane it is on, else along the traffic that drives over its place, else along its own slight
motion. Otherwise the heading is a guess, and `Track.guessed` says so.
"""

from collections.abc import Iterable
from functools import cached_property
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Float, Int

from regents_cosim.geometry.frames import wrap
from regents_cosim.geometry.lines import heading_near, steps_along
from regents_cosim.scenario.scenario import Agent
from regents_cosim.sources.logs.scene import LoggedMap, Track

_STIR_M = 0.5  # closer positions count as one, since detections of a standing road user scatter
_MOVED_M, _PARTS = 0.8, 8  # one whose positions stay within this never moves; measured between the means of its parts
_BACKS_RAD = np.deg2rad(110.0)  # a vehicle that turns by more from one position to the next drives backwards
_OVER_M = 1.5  # traffic that comes this close to a place drives over it
_AGREES = 0.9  # length of the mean unit vector from which traffic over a place agrees
_ALIKE_RAD = np.deg2rad(45.0)  # lanes on one place that differ by more decide nothing
_BESIDE_M = 0.5  # a lane is also on a place if its centre line is farther than the nearest by less
_MOST_LANES = 50  # on one place; with more, lanes decide nothing
_LOOK_M = 30.0  # lanes and traffic within this distance serve for a guess
_CELL_M, _SECTORS = 1.0, 12  # traffic is thinned to one piece per cell and direction
_SEEN_M = 10.0  # longer pieces are gaps of the log


class RawTrack(NamedTuple):
    """A road user as a log has it, possibly without headings."""

    agent: Agent
    step: Int[np.ndarray, " sample"]
    x: Float[np.ndarray, " sample"]  # [m]
    y: Float[np.ndarray, " sample"]  # [m]
    yaw: Float[np.ndarray, " sample"]  # [rad], NaN where the log has none


def with_headings(found: Iterable[RawTrack], road: LoggedMap | None = None, along: float | None = None) -> list[Track]:
    """Tracks with headings, in the same order; `along` is the direction [rad] of all lanes, where a format has one."""
    found = [one._replace(yaw=with_own_motion(one)) for one in found]
    moved = [one for one in found if not np.isnan(one.yaw).any()]
    places = _Places(road or LoggedMap(), moved, along)
    return [_track(one, places) for one in found]


def with_own_motion(one: RawTrack) -> Float[np.ndarray, " sample"]:
    """The headings of a road user, filled in from its motion where missing; all NaN if it has neither."""
    missing = np.isnan(one.yaw)
    if not missing.any():
        return one.yaw
    motion = heading_from_motion(one.x, one.y, backs=one.agent.kind != "pedestrian")
    if motion is not None:
        return np.where(missing, motion, one.yaw)
    if missing.all():
        return one.yaw
    known = np.flatnonzero(~missing)
    after = np.clip(np.searchsorted(known, np.arange(len(missing))), 0, len(known) - 1)
    before = np.maximum(after - 1, 0)
    here = np.arange(len(missing))
    nearer = np.abs(known[before] - here) < np.abs(known[after] - here)
    return one.yaw[np.where(nearer, known[before], known[after])]


def heading_from_motion(
    x: Float[np.ndarray, " sample"], y: Float[np.ndarray, " sample"], backs: bool = False
) -> Float[np.ndarray, " sample"] | None:
    """The direction of motion at each sample [rad], the last or next one while standing; None if it never moves.

    It is computed from positions at least 0.5 m apart, so that detection noise does not count as motion. With `backs` a
    turn on the spot counts as a change to driving backwards; the vehicle is assumed to drive forwards for most of its
    path.
    """
    if not len(x) or _extent_m(x, y) < _MOVED_M:
        return None
    at = _anchors(x, y)
    if len(at) < 2:
        return None
    step = np.diff(x[at] + 1j * y[at])
    if backs:
        turned = np.abs(np.angle(step[1:] / step[:-1])) > _BACKS_RAD
        sign = np.where(np.concatenate([[0], np.cumsum(turned)]) % 2, -1.0, 1.0)
        step = step * (sign if (sign * np.abs(step)).sum() >= 0 else -sign)
    chord = np.concatenate([[0.0], step]) + np.concatenate([step, [0.0]])  # from the previous anchor to the next one
    chord = np.where(np.abs(chord) < 0.5 * _STIR_M, np.concatenate([step[:1], step]), chord)
    yaw = np.unwrap(np.angle(chord))
    piece = np.clip(np.searchsorted(at, np.arange(len(x)), side="right") - 1, 0, len(at) - 2)
    way = np.diff(x[at] + 1j * y[at])[piece]
    gone = (x - x[at][piece]) + 1j * (y - y[at][piece])
    part = np.clip((gone * way.conj()).real / np.abs(way) ** 2, 0.0, 1.0)
    return np.asarray(wrap(yaw[piece] + part * (yaw[piece + 1] - yaw[piece])))


def _extent_m(x: np.ndarray, y: np.ndarray) -> float:
    """The extent of a road user's positions [m], with detection noise averaged out."""
    starts = np.linspace(0, len(x), min(_PARTS, len(x)), endpoint=False).astype(int)
    number = np.diff([*starts, len(x)])
    width, height = (float(np.ptp(np.add.reduceat(values, starts) / number)) for values in (x, y))
    return float(np.hypot(width, height))


def _anchors(x: np.ndarray, y: np.ndarray) -> Int[np.ndarray, " place"]:
    """Indices of samples at least 0.5 m from the previous one; the first sample is included."""
    if len(x) > 1 and steps_along(x, y).min() >= _STIR_M:
        return np.arange(len(x))
    found, here = [0], complex(x[0], y[0])
    for i, place in enumerate((x + 1j * y).tolist()):
        if abs(place - here) >= _STIR_M:
            found.append(i)
            here = place
    return np.array(found)


def _track(one: RawTrack, places: "_Places") -> Track:
    agent, step, x, y, yaw = one
    if not np.isnan(yaw).any():
        return Track(agent, step, x, y, yaw)
    here = complex(np.median(x), np.median(y))
    on_foot = agent.kind == "pedestrian"
    direction = None if on_foot else places.direction(here)
    direction = _drift(x, y) if direction is None else direction
    guessed = direction is None and not on_foot
    if direction is None:
        direction = 0.0 if on_foot else places.guess(here)
    return Track(agent, step, x, y, np.full(len(x), direction), guessed=guessed)


def _drift(x: np.ndarray, y: np.ndarray) -> float | None:
    """The direction from the mean of the first quarter of positions to that of the last [rad]; None: no drift."""
    part = max(len(x) // 4, 1)
    way = complex(x[-part:].mean() - x[:part].mean(), y[-part:].mean() - y[:part].mean())
    return float(np.angle(way)) if abs(way) >= _STIR_M else None


class _Places:
    """The directions that lanes and traffic have at a place."""

    def __init__(self, road: LoggedMap, moved: list[RawTrack], along: float | None) -> None:
        self._lanes, self._moved, self._along = road.lanes, moved, along
        self._widest_m = max((lane.width for lane in self._lanes), default=0.0)

    def direction(self, here: complex) -> float | None:
        """The direction of the lane [rad], or of the traffic over the place; None where neither is known."""
        lane = self._of_lane(here)
        if lane is not None:
            return lane
        return self._along if self._along is not None else self._of_traffic(here)

    def guess(self, here: complex) -> float:
        """The direction of the nearest lane, else of the nearest traffic [rad]; 0 where there is none near."""
        point = shapely.Point(here.real, here.imag)
        found = self._lines.query_nearest(point, max_distance=_LOOK_M, all_matches=False)
        if len(found):
            return self._at(int(found[0]), point)
        places, yaw = self._traffic
        found = places.query_nearest(point, max_distance=_LOOK_M, all_matches=False)
        return float(yaw[found[0]]) if len(found) else 0.0

    def _of_lane(self, here: complex) -> float | None:
        point = shapely.Point(here.real, here.imag)
        near = self._lines.query(point, predicate="dwithin", distance=0.5 * self._widest_m).tolist()
        if len(near) > _MOST_LANES:
            return None
        away = {i: float(shapely.distance(self._lines.geometries[i], point)) for i in near}
        away = {i: m for i, m in away.items() if m <= 0.5 * self._lanes[i].width}
        if not away:
            return None
        nearest = min(away, key=lambda i: away[i])
        direction = self._at(nearest, point)
        rivals = [self._at(i, point) for i, m in away.items() if m <= away[nearest] + _BESIDE_M]
        return direction if all(abs(wrap(other - direction)) <= _ALIKE_RAD for other in rivals) else None

    def _of_traffic(self, here: complex) -> float | None:
        places, yaw = self._traffic
        near = places.query(shapely.Point(here.real, here.imag), predicate="dwithin", distance=_OVER_M)
        mean = np.exp(1j * yaw[near]).mean() if len(near) else 0.0
        return float(np.angle(mean)) if abs(mean) > _AGREES else None

    def _at(self, lane: int, point: shapely.Point) -> float:
        """The direction of a lane beside a place [rad]."""
        return heading_near(self._lines.geometries[lane], point)

    @cached_property
    def _lines(self) -> shapely.STRtree:
        return shapely.STRtree([shapely.LineString(lane.centre) for lane in self._lanes])

    @cached_property
    def _traffic(self) -> tuple[shapely.STRtree, Float[np.ndarray, " piece"]]:
        """The pieces that other road users drove, and the heading of each piece."""
        drive = [one for one in self._moved if one.agent.kind != "pedestrian"]
        pieces = [np.zeros((5, 0)), *(_pieces(one) for one in drive)]
        x, y, dx, dy, yaw = np.concatenate(pieces, axis=1)
        sector = (yaw % (2.0 * np.pi)) // (2.0 * np.pi / _SECTORS)
        cell = (x - x[:1]) // _CELL_M, (y - y[:1]) // _CELL_M  # relative to the first one, to keep the numbers small
        kept = np.unique(np.stack([*cell, sector]), axis=1, return_index=True)[1]
        x, y, dx, dy, yaw = (values[kept] for values in (x, y, dx, dy, yaw))
        ends = np.stack([np.stack([x, y], axis=-1), np.stack([x + dx, y + dy], axis=-1)], axis=1)
        return shapely.STRtree(np.asarray(shapely.linestrings(ends))), yaw


def _pieces(one: RawTrack) -> Float[np.ndarray, "5 piece"]:
    """Start, displacement [m] and heading [rad] of every piece of a track, x before y."""
    at = _anchors(one.x, one.y)
    x, y, yaw = one.x[at], one.y[at], one.yaw[at]
    found = np.stack([x[:-1], y[:-1], np.diff(x), np.diff(y), yaw[:-1]])
    return found[:, np.hypot(found[2], found[3]) < _SEEN_M]
