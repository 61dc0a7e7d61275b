"""Finds encounters of two agents: a leader ahead, paths that cross, and paths that join.

A path is the line that the middle of an agent's front drove, from its rear at first and 50 m straight on, or only 5 m
if it was turning or never drove, since its direction is then unknown. Lanes are ignored, so that agents off their lanes
count too.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.geometry.boxes import same_level
from regents_cosim.geometry.frames import wrap
from regents_cosim.geometry.lines import distances_along
from regents_cosim.norms.limits import ALONG_RAD
from regents_cosim.scenario.scenario import Agent, Tracks

_BEYOND_M = 50.0  # as in SUMO's device
_BEYOND_A_TURN_M = 5.0
_TURNING_RAD = np.deg2rad(5.0)  # within the last 5 m
_DROVE_M = 1.0  # an agent that drove less counts as standing
_ACROSS_RAD = np.deg2rad(15.0)  # paths that meet at a smaller angle neither cross nor join: a lane change, or head-on
_AS_ONE_RAD = np.deg2rad(2.0)  # paths that lie on each other with a smaller difference of directions have joined
_STANDING_M = 1e-6  # shorter steps do not count as motion
_SPACING_M = 0.5  # between the points at which two paths are compared
_MOST_POINTS = 20_000  # on paths beyond 10 km, which are not drives, the points are sparser
_CHORD_M = 1.0  # before and behind a point, for its direction

Steps = Float[np.ndarray, " time"]


class FrontPath:
    """The path of one agent's front: a line, and the front's position along it at each step."""

    def __init__(self, agent: Agent, tracks: Tracks, index: int, dt: float) -> None:
        """`index` is the agent's row in `tracks`; it must be valid at two steps at least."""
        self.agent = agent
        self.there = tracks.valid[index]
        steps = np.flatnonzero(self.there)
        self.points = np.stack([tracks.x[index], tracks.y[index]], axis=-1)  # of the centre
        self.yaw = tracks.yaw[index]
        self.z = tracks.z[index]  # [m] of the road
        self.speed = np.where(self.there, tracks.speed[index], np.nan)
        self.accel = np.nan_to_num(np.diff(self.speed, prepend=np.nan)) / dt  # [m/s^2] of the last step
        ahead = np.stack([np.cos(self.yaw), np.sin(self.yaw)], axis=-1)
        self._driven, self._yaws = (self.points + 0.5 * agent.length * ahead)[steps], np.unwrap(self.yaw[steps])
        self._s = agent.length + distances_along(*self._driven.T)
        self.s = np.full(len(self.there), np.nan)  # [m] position of the front along the line; NaN where absent
        self.s[steps] = self._s

    @cached_property
    def _corners(self) -> tuple[Float[np.ndarray, "point 2"], Float[np.ndarray, " point"]]:
        """Points of the line [m], as driven and extended, and their positions along it [m]."""
        moved = np.diff(self._s, prepend=-np.inf) > _STANDING_M
        end, ahead = self._s[-1], np.stack([np.cos(self._yaws), np.sin(self._yaws)], axis=-1)
        turned = np.abs(self._yaws[-1] - np.interp(end - _BEYOND_A_TURN_M, self._s, self._yaws)) > _TURNING_RAD
        beyond = _BEYOND_A_TURN_M if turned or end - self._s[0] < _DROVE_M else _BEYOND_M
        rear, onward = self._driven[0] - self.agent.length * ahead[0], self._driven[-1] + beyond * ahead[-1]
        return (
            np.concatenate([rear[None], self._driven[moved], onward[None]]),
            np.concatenate([[0.0], self._s[moved], [end + beyond]]),
        )

    @cached_property
    def line(self) -> shapely.LineString:
        """The path, as driven and extended."""
        return shapely.LineString(self._corners[0])

    def at(self, s: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 2"]:
        """Points at distances along the line [m]."""
        corners, along = self._corners
        return np.stack([np.interp(s, along, corners[:, 0]), np.interp(s, along, corners[:, 1])], axis=-1)

    def height(self, s: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Height of the road [m] at distances along the line; constant beyond its ends."""
        return np.interp(s, self._s, self.z[self.there])

    def place(self, points: Float[np.ndarray, "n 2"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """The distance along the line and the distance from it, of points [m]."""
        s = np.asarray(shapely.line_locate_point(self.line, shapely.points(points)))
        return s, np.hypot(*(points - self.at(s)).T)

    def direction(self, s: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Direction of the line at `s` [rad]."""
        chord = self.at(s + _CHORD_M) - self.at(s - _CHORD_M)
        return np.arctan2(chord[:, 1], chord[:, 0])


@dataclass(frozen=True, eq=False)
class FollowingPair:
    """A pair of which one follows the other; NaN at steps where it does not follow."""

    gap: Steps  # [m] from the follower's front to the leader's rear, along the path
    closing: Steps  # [m/s] rate at which the gap shrinks


def followings(ego: FrontPath, other: FrontPath) -> Iterator[FollowingPair]:
    """All following pairs, by the path of either and with either ahead: one may have swerved, but rarely both."""
    beside = 0.5 * (ego.agent.width + other.agent.width)
    for owner, guest in ((ego, other), (other, ego)):
        s, away = owner.place(guest.points)
        turn = np.cos(guest.yaw - owner.direction(s))
        aligned = ((turn > np.cos(ALONG_RAD)) | (turn < -np.cos(_ACROSS_RAD))) & (away < beside) & (s > 0.0)
        aligned &= same_level(owner.height(s), guest.z)
        ahead = np.where(aligned & owner.there & guest.there, s - owner.s, np.nan)
        approach = owner.speed - guest.speed * turn
        behind = -ahead - owner.agent.length
        for gap, closing in ((ahead, approach), (behind, -approach)):
            free = gap - 0.5 * guest.agent.length
            yield FollowingPair(np.where(free > 0.0, free, np.nan), np.where(free > 0.0, closing, np.nan))


@dataclass(frozen=True, eq=False)
class Approach:
    """One of two agents that approach a common area; NaN where it is absent."""

    entry: Steps  # [m] from its front to the begin of the area, negative behind it
    exit: Steps  # [m] until its rear has left the area
    speed: Steps  # [m/s]
    accel: Steps  # [m/s^2]


def crossing(ego: FrontPath, other: FrontPath) -> tuple[Approach, Approach] | None:
    """The approaches to the first place where the two paths cross; None where they do not.

    The area is where the bands swept by the two bodies meet: at a right angle it ends half of the other's width before
    and behind that place, as in SUMO's SSM device. At other angles the device has an area of the same length, but
    shifts it by the widths of the lanes and by where the lanes wait.
    """
    meeting = shapely.get_coordinates(shapely.intersection(ego.line, other.line))
    if not len(meeting):
        return None
    (own, _), (others, _) = ego.place(meeting), other.place(meeting)
    turn = np.abs(wrap(ego.direction(own) - other.direction(others)))
    across = np.minimum(turn, np.pi - turn) > _ACROSS_RAD
    across &= same_level(ego.height(own), other.height(others))
    if not across.any():
        return None
    first = np.flatnonzero(across)[np.argmin(own[across])]
    angle, at = float(turn[first]), (float(own[first]), float(others[first]))
    return _approach(ego, at[0], _reach(ego, other, angle)), _approach(other, at[1], _reach(other, ego, angle))


def _reach(way: FrontPath, foe: FrontPath, angle: float) -> float:
    """How far [m] before and behind the crossing the corners of an agent are in the band of the other's width."""
    return 0.5 * (foe.agent.width + way.agent.width * abs(np.cos(angle))) / np.sin(angle)


def _approach(way: FrontPath, place: float, reach: float) -> Approach:
    entry = place - reach - way.s
    return Approach(entry, entry + way.agent.length + 2.0 * reach, way.speed, way.accel)


def joining(ego: FrontPath, other: FrontPath) -> tuple[Approach, Approach] | None:
    """The approaches to the place from which two paths of different directions are one; None where there is none.

    The area is that place only, and an agent approaches it while it lies ahead, as in SUMO's SSM device; behind it one
    of the two follows the other.
    """
    touching = 0.5 * (ego.agent.width + other.agent.width)
    if shapely.distance(ego.line, other.line) > touching:
        return None
    own = np.arange(0.0, ego.line.length, max(_SPACING_M, ego.line.length / _MOST_POINTS))
    others, away = other.place(ego.at(own))
    turn = np.abs(wrap(ego.direction(own) - other.direction(others)))
    beside = (away < touching) & (turn < ALONG_RAD) & same_level(ego.height(own), other.height(others))
    begins = np.flatnonzero(beside & ~np.append(True, beside[:-1]) & (turn > _ACROSS_RAD))
    for first in begins:
        last = first + np.argmin(np.append(beside[first:], False))
        joined = np.flatnonzero(turn[first:last] < _AS_ONE_RAD)
        if len(joined):
            place = first + joined[0]
            return _approach(ego, float(own[place]), 0.0), _approach(other, float(others[place]), 0.0)
    return None
