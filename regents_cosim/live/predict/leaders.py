"""Finds the next vehicle ahead on the path of each, for the prediction of traffic.

Points in the plane are complex numbers, x + iy in metres, so that a change of frame is one multiplication.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from regents_cosim.live.predict.giving_way import FAR_M
from regents_cosim.live.predict.paths import BEHIND_M, SPACING_M, Crossing
from regents_cosim.live.predict.traffic import RoadUser, TrafficState
from regents_cosim.maps.right_of_way import Priorities, priorities

_CELL_M = 2.0  # of the grid that gives a nearby point of a path
_NEAR_CELLS = 1  # cells around a point that refer to it
_OFF_POINT_M = 1.42 * (_NEAR_CELLS + 1) * _CELL_M  # places in these cells are closer to the point (diagonal)
_PARTS = 3  # places of a body: front, middle, rear
_BESIDE_M = 0.1  # a leader may be this far beside the body


@dataclass(frozen=True, eq=False)
class Leaders:
    """The paths of all vehicles, and the bodies on them."""

    points: Complex[np.ndarray, "user point"]  # [m] of the paths, every `SPACING_M`
    ways: Complex[np.ndarray, "user point"]  # unit vectors from each point to the next
    near: Int[np.ndarray, "user cell"]  # a point of the path near each cell, -1 for none
    side: int  # cells along a side of the periodic grid; no path is wider
    length: Float[np.ndarray, " user"]  # [m]
    beside: Float[np.ndarray, "user other"]  # [m] lateral distance from which a body is no longer on the path

    @classmethod
    def of(
        cls,
        paths: Sequence[Float[np.ndarray, "_ 2"]],
        length: Float[np.ndarray, " user"],
        width: Float[np.ndarray, " user"],
    ) -> "Leaders":
        """Leaders on paths [m], continued straight after their last two points; lengths and widths [m] of bodies."""
        most = max(map(len, paths))
        points = np.stack([_prolonged(path @ np.array([1.0, 1.0j]), most) for path in paths])
        ahead = np.diff(points, axis=1)
        ahead = np.concatenate([ahead, ahead[:, -1:]], axis=1)
        near, side = _grid(points)
        beside = 0.5 * (width[:, None] + width) + _BESIDE_M
        np.fill_diagonal(beside, -np.inf)  # no vehicle leads itself
        return cls(points, ahead / np.maximum(np.abs(ahead), 1e-6), near, side, length, beside)

    def index(self, along: Float[np.ndarray, " user"]) -> Int[np.ndarray, " user"]:
        """The indices of the points beside fronts that have driven `along` [m]."""
        return np.clip((along / SPACING_M + BEHIND_M).astype(int), 0, self.points.shape[1] - 1)

    def at(self, along: Float[np.ndarray, "user *axes"]) -> Complex[np.ndarray, "user *axes"]:
        """Places on the paths, at distances [m] from the fronts' initial positions."""
        at = np.clip(along / SPACING_M + BEHIND_M, 0.0, self.points.shape[1] - 1.001)
        index = at.astype(int)
        part = at - index
        user = np.arange(len(along)).reshape(-1, *(1,) * (along.ndim - 1))
        return self.points[user, index] * (1.0 - part) + self.points[user, index + 1] * part

    def ahead(
        self, along: Float[np.ndarray, " user"], speed: Float[np.ndarray, " user"]
    ) -> tuple[Float[np.ndarray, " user"], Float[np.ndarray, " user"]]:
        """The gap to the nearest body on each path [m], `FAR_M` for none, and its speed along the path [m/s].

        `along` is the distance driven [m], `speed` the speed [m/s], which is returned where there is no leader.
        """
        back = np.multiply.outer(self.length, np.linspace(0.0, 1.0, _PARTS))
        body = self.at(along[:, None] - back)  # [other part]
        index = self.near[:, _cell(body.ravel(), self.side)]  # [user part]
        # Most bodies near a path are behind: they are removed first.
        first = np.maximum(along / SPACING_M + BEHIND_M - 0.5 * self.length - _OFF_POINT_M, 0.0)
        hit = np.flatnonzero(index >= first[:, None])
        user, part = np.divmod(hit, index.shape[1])
        known, other = index.ravel().take(hit), part // _PARTS
        on_path = user * self.points.shape[1] + known
        off = body.ravel().take(part) - self.points.ravel().take(on_path)
        off *= self.ways.ravel().take(on_path).conj()  # relative to the point: ahead, and to the left
        gap = known * SPACING_M - BEHIND_M + off.real - along.take(user)
        leads = (np.abs(off.imag) < self.beside[user, other]) & (gap > -0.5 * self.length.take(user))
        leads &= np.abs(off.real) < _OFF_POINT_M  # not a whole period of the grid away
        gaps = np.full(index.shape, FAR_M)
        gaps.ravel()[hit[leads]] = gap[leads]
        mine, part = np.arange(len(along)), gaps.argmin(axis=1)
        nearest, other = gaps[mine, part], part // _PARTS
        heading = body[other, 0] - body[other, -1]
        turned = heading * self.ways[mine, np.maximum(index[mine, part], 0)].conj()
        lead = np.maximum(speed[other] * turned.real / np.maximum(np.abs(heading), 1e-6), 0.0)
        return nearest, np.where(nearest < FAR_M, lead, speed)


def _prolonged(points: Complex[np.ndarray, " point"], most: int) -> Complex[np.ndarray, " most"]:
    return np.concatenate([points, points[-1] + np.arange(1, most - len(points) + 1) * (points[-1] - points[-2])])


def _grid(points: Complex[np.ndarray, "user point"]) -> tuple[Int[np.ndarray, "user cell"], int]:
    """For every user the cells around its path with a point of it, and the number of cells per side."""
    x, y = np.real(points), np.imag(points)
    widest = max(float(np.ptp(values, axis=1).max()) for values in (x, y))
    side = int(widest / _CELL_M) + 2 * _NEAR_CELLS + 2
    near = np.full((len(points), side * side), -1, np.int16)
    user, number = np.arange(len(points))[:, None], np.arange(points.shape[1])
    beside = np.arange(-_NEAR_CELLS, _NEAR_CELLS + 1) * _CELL_M
    for up, right in itertools.product(beside, beside):
        near[user, _cell(points + complex(right, up), side)] = number
    return near, side


def _cell(places: Complex[np.ndarray, "*axes"], side: int) -> Int[np.ndarray, "*axes"]:
    """The cells of places [m] in the periodic grid."""
    column, row = (np.rint(values / _CELL_M).astype(int) % side for values in (np.real(places), np.imag(places)))
    return row * side + column


# Predicts which vehicles brake for one that crosses the junction ahead of them, even if they have priority.
# The rule is SUMO's (`MSLink::getLeaderInfo`, `MSVehicle::isLeader`): once a vehicle is inside a junction, all
# vehicles that come into it later on a conflicting path brake before the conflict until it has passed. The rule is
# only applied to vehicles with a known drive, which are adversaries: all others have given way before (`giving_way`).
_LANE_M = 3.2  # SUMO's default width of a lane: paths conflict if they come nearer than half of it
_LEAST_M_S = 0.1


@dataclass(frozen=True, eq=False)
class LinkLeaders:
    """Pairs of conflicting paths in a junction; the first of each pair belongs to a vehicle with a known drive."""

    users: Int[np.ndarray, "2 pair"]
    enters: Float[np.ndarray, "2 pair"]  # [m] from the fronts' initial positions
    meets: Float[np.ndarray, "2 pair"]  # likewise
    length: Float[np.ndarray, " pair"]  # [m] of the vehicles inside
    came_first: Bool[np.ndarray, " pair"]  # the other is inside now, and was so earlier

    @classmethod
    def of(cls, traffic: TrafficState, users: Sequence[RoadUser]) -> "LinkLeaders":
        """The pairs of some traffic, for `users` with known drives; empty where the map has no junctions."""
        table = priorities(traffic.road) or Priorities({}, {})
        rows = [
            meeting
            for index, user in enumerate(users)
            if user.drive is not None
            for other_index, other in enumerate(users)
            if other_index not in (0, index) and other.drive is None  # the ego's planner does not follow this rule
            for one in user.path.crossings
            for two in other.path.crossings
            if (meeting := _meeting((index, user, one), (other_index, other, two), table)) is not None
        ]
        inside, comes, enters, meets, length, other_enters, other_meets = np.array(rows).reshape(-1, 7).T
        pair = np.stack([inside, comes]).astype(int)
        enters, meets = np.stack([enters, other_enters]), np.stack([meets, other_meets])
        since_s = _since_s(-enters, traffic.values("speed")[pair], np.nan_to_num(traffic.values("accel"))[pair])
        return cls(pair, enters, meets, length, since_s[1] > since_s[0])

    def first(
        self, along: Float[np.ndarray, " user"], came_first: Bool[np.ndarray, " pair"]
    ) -> Bool[np.ndarray, " pair"]:
        """Whether the others came into the junction first, once all have driven `along` [m]."""
        inside = along[self.users] >= self.enters
        return np.where(inside[0], came_first, inside[1])

    def ahead(
        self, along: Float[np.ndarray, " user"], came_first: Bool[np.ndarray, " pair"]
    ) -> tuple[Bool[np.ndarray, " pair"], Float[np.ndarray, " pair"], Float[np.ndarray, " pair"]]:
        """Which of the others brake, their distances to the conflict, and the gaps as if both were on one line [m]."""
        inside, left = along[self.users] >= self.enters, self.meets - along[self.users]
        passes = left[0] + self.length  # until its rear reaches the other path
        minds = inside[0] & ~came_first & (passes + _LANE_M > 0.0) & (left[1] > 0.0)
        return minds, left[1], left[1] - passes - _LANE_M


def _meeting(
    one: tuple[int, RoadUser, Crossing], two: tuple[int, RoadUser, Crossing], table: Priorities
) -> tuple[float, ...] | None:
    """The conflict of two paths through one junction; None where there is none, or they share a lane.

    It has the numbers of the two users, of the first the distances [m] to the junction and to the conflict and the
    length, of the other these distances.
    """
    (index, user, crossing), (other_index, other, coming) = one, two
    link, other_link = table.links.get(crossing.lane), table.links.get(coming.lane)
    if link is None or other_link is None or link.junction != other_link.junction or link == other_link:
        return None
    own, own_m = _inside(user, crossing)
    others, others_m = _inside(other, coming)
    if not len(own) or not len(others):
        return None
    apart = np.hypot(*(own[:, None] - others[None]).transpose(2, 0, 1))
    meets = np.flatnonzero(apart.min(axis=0) < 0.5 * _LANE_M)
    if not len(meets):
        return None
    at = meets[0]
    mine = crossing.enters_m, float(own_m[apart[:, at].argmin()]), user.agent.length
    return index, other_index, *mine, coming.enters_m, float(others_m[at])


def _since_s(
    metres: Float[np.ndarray, "2 pair"], speed: Float[np.ndarray, "2 pair"], accel: Float[np.ndarray, "2 pair"]
) -> Float[np.ndarray, "2 pair"]:
    """How long ago [s] vehicles passed a place, given their current speeds and accelerations [m/s^2]."""
    before = np.sqrt(np.maximum(speed**2 - 2.0 * accel * metres, 0.0))
    return np.maximum(metres, 0.0) / np.maximum(0.5 * (before + speed), _LEAST_M_S)


def _inside(user: RoadUser, crossing: Crossing) -> tuple[Float[np.ndarray, "point 2"], Float[np.ndarray, " point"]]:
    """The part of a path inside a junction, and the distances of its points ahead of the front bumper [m]."""
    points = user.path.points
    begin, end = (round(metres / SPACING_M) + BEHIND_M for metres in (crossing.enters_m, crossing.leaves_m))
    numbers = np.arange(max(begin, 0), min(end + 1, len(points)))
    return points[numbers], (numbers - BEHIND_M) * SPACING_M
