"""Predicts which vehicles brake for one that crosses the junction ahead of them, even if they have priority.

The rule is SUMO's (`MSLink::getLeaderInfo`, `MSVehicle::isLeader`): once a vehicle is inside a junction, all vehicles
that come into it later on a conflicting path brake before the conflict until it has passed. The rule is only applied to
vehicles with a known drive, which are adversaries: all others have given way before (`giving_way`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from regents_cosim.live.predict.paths import BEHIND_M, SPACING_M, Crossing
from regents_cosim.live.predict.traffic import RoadUser, TrafficState
from regents_cosim.maps.right_of_way import Priorities, priorities

_LANE_M = 3.2  # SUMO's default width of a lane: paths conflict if they come nearer than half of it
_LEAST_M_S = 0.1


class _Meeting(NamedTuple):
    """The conflict of a vehicle inside a junction with one that comes there; distances ahead of their fronts [m]."""

    inside: int  # the user with a known drive
    comes: int  # the other user
    enters_m: float  # from the drive's begin to the junction
    meets_m: float  # from the drive's begin to the conflict
    length_m: float  # length of the vehicle on the drive
    other_enters_m: float  # from the other user to the junction
    other_meets_m: float  # from the other user to the conflict


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
) -> _Meeting | None:
    """The conflict of two paths through one junction; None where there is none, or they share a lane."""
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
    return _Meeting(
        index, other_index, crossing.enters_m, float(own_m[apart[:, at].argmin()]), user.agent.length,
        coming.enters_m, float(others_m[at]),
    )  # fmt: skip


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
