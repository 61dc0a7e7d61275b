"""Encounters: who is on whose way. A leader ahead, or a place where two ways cross.

A way is the line that an agent's centre drove, and 50 m straight on. Lanes are not asked, so that what leaves its lane
is seen as well.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.frames import wrap
from regents_cosim.scenario import Agent, Tracks

_BEYOND_M = 50.0  # SUMO's device looks as far
_ALONG_RAD = np.deg2rad(45.0)  # headings that differ by less follow each other
_ACROSS_RAD = np.deg2rad(15.0)  # ways that meet at less merge: there is no place where they cross
_STANDING_M = 1e-6  # a step that is no way

Steps = Float[np.ndarray, " time"]


class Way:
    """Where one agent drove: a line, and how far along it the agent is at each step."""

    def __init__(self, agent: Agent, tracks: Tracks, index: int, dt: float) -> None:
        """`index` is the agent's row in `tracks`; it must be valid at two steps at least."""
        self.agent = agent
        self.there = tracks.valid[index]
        steps = np.flatnonzero(self.there)
        self.points = np.stack([tracks.x[index], tracks.y[index]], axis=-1)  # [time, 2]
        self.yaw = tracks.yaw[index]
        self.speed = np.where(self.there, tracks.speed[index], np.nan)
        self.accel = np.gradient(self.speed, dt)
        self._driven, self._yaws = self.points[steps], np.unwrap(self.yaw[steps])
        ways = np.hypot(*np.diff(self._driven, axis=0).T)
        self._s = np.concatenate([[0.0], np.cumsum(ways)])
        self.s = np.full(len(self.there), np.nan)  # [m] along the line, of the centre; NaN where absent
        self.s[steps] = self._s

    @cached_property
    def _corners(self) -> tuple[Float[np.ndarray, "point 2"], Float[np.ndarray, " point"]]:
        """Points of the line [m], as driven and 50 m straight on, and how far along it they are [m]."""
        moved = np.diff(self._s, prepend=-np.inf) > _STANDING_M
        onward = self._driven[-1] + _BEYOND_M * np.array([np.cos(self._yaws[-1]), np.sin(self._yaws[-1])])
        return np.concatenate([self._driven[moved], onward[None]]), np.append(self._s[moved], self._s[-1] + _BEYOND_M)

    @cached_property
    def line(self) -> shapely.LineString:
        """The way, as driven and 50 m straight on."""
        return shapely.LineString(self._corners[0])

    def place(self, points: Float[np.ndarray, "n 2"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Distance along the line, and from it, of points [m]."""
        s = np.asarray(shapely.line_locate_point(self.line, shapely.points(points)))
        corners, at = self._corners
        return s, np.hypot(
            points[:, 0] - np.interp(s, at, corners[:, 0]), points[:, 1] - np.interp(s, at, corners[:, 1])
        )

    def heading(self, s: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Heading of the agent at `s` [rad]."""
        return np.interp(s, self._s, self._yaws)


@dataclass(frozen=True, eq=False)
class Following:
    """One behind the other; NaN at steps where the follower does not follow."""

    gap: Steps  # [m] from the follower's front to the leader's rear, along the way
    closing: Steps  # [m/s] how fast it shrinks


def followings(ego: Way, other: Way) -> Iterator[Following]:
    """Both by the ego's way and by the other's, the ego behind or ahead: one may have swerved, seldom both."""
    half = 0.5 * (ego.agent.length + other.agent.length)
    beside = 0.5 * (ego.agent.width + other.agent.width)
    for owner, guest in ((ego, other), (other, ego)):
        s, away = owner.place(guest.points)
        turn = np.cos(guest.yaw - owner.heading(s))
        aligned = (np.abs(turn) > np.cos(_ALONG_RAD)) & (away < beside) & (s > 0.0)
        ahead = np.where(aligned & owner.there & guest.there, s - owner.s, np.nan)
        approach = owner.speed - guest.speed * turn
        for gap, closing in ((ahead - half, approach), (-ahead - half, -approach)):
            yield Following(np.where(gap > 0.0, gap, np.nan), np.where(gap > 0.0, closing, np.nan))


@dataclass(frozen=True, eq=False)
class Approach:
    """One of two agents on its way to the area that both pass; NaN where it is absent."""

    entry: Steps  # [m] from its front to the beginning of the area, negative behind it
    exit: Steps  # [m] until its rear has left the area
    speed: Steps  # [m/s]
    accel: Steps  # [m/s^2]


def crossing(ego: Way, other: Way) -> tuple[Approach, Approach] | None:
    """The first place where the two ways cross, None where they do not.

    The area ends half of the other's width before and behind that place, as in SUMO's SSM device.
    """
    meeting = shapely.get_coordinates(shapely.intersection(ego.line, other.line))
    if not len(meeting):
        return None
    (own, _), (others, _) = ego.place(meeting), other.place(meeting)
    across = np.abs(wrap(ego.heading(own) - other.heading(others)))
    across = np.minimum(across, np.pi - across) > _ACROSS_RAD
    if not across.any():
        return None
    first = np.flatnonzero(across)[np.argmin(own[across])]
    return _approach(ego, float(own[first]), other), _approach(other, float(others[first]), ego)


def _approach(way: Way, place: float, foe: Way) -> Approach:
    entry = place - 0.5 * foe.agent.width - 0.5 * way.agent.length - way.s
    return Approach(entry, entry + way.agent.length + foe.agent.width, way.speed, way.accel)
