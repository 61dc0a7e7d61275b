"""Predicts which vehicles wait at junctions, by the network's right of way.

The rule is SUMO's (`MSLink::opened`): a vehicle may enter if all that have priority over it have left before it comes,
or come some time after it has left, assuming that all accelerate as they can. Waiting vehicles have no priority.
"""

from collections import defaultdict
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from regents_cosim.geometry.lines import seconds_for
from regents_cosim.live.predict.car_following import stops_within
from regents_cosim.live.predict.paths import Crossing
from regents_cosim.live.predict.traffic import RoadUser, TrafficState
from regents_cosim.maps.right_of_way import JunctionMovement, Priorities, priorities

_CLEAR_S = 1.0  # margin before the others come
_SLOWS = 1.5  # [m/s^2] braking for a slower lane in the junction
_LEAST_M_S = 0.1
FAR_M = 1e4


class _JunctionPassage(NamedTuple):
    """The path of a user through a junction."""

    user: int
    enters_m: float  # [m] from the front's initial position to the junction
    leaves_m: float  # [m] likewise, until the whole body has left
    fastest: float  # [m/s] wanted speed inside
    accel: float  # [m/s^2]
    decel: float  # [m/s^2]

    @classmethod
    def of(cls, index: int, user: RoadUser, crossing: Crossing, limit: float) -> "_JunctionPassage":
        follows = user.following
        fastest = max(min(limit * follows.speed_factor, follows.max_speed_m_s), _LEAST_M_S)
        leaves_m = crossing.leaves_m + user.agent.length
        return cls(index, crossing.enters_m, leaves_m, fastest, follows.accel, follows.decel)


@dataclass(frozen=True, eq=False)
class GivingWay:
    """Pairs of paths through junctions; the first user of each pair gives way to the second."""

    users: Int[np.ndarray, "2 pair"]
    enters: Float[np.ndarray, "2 pair"]  # see `_JunctionPassage`, like the following
    leaves: Float[np.ndarray, "2 pair"]
    fastest: Float[np.ndarray, "2 pair"]
    accel: Float[np.ndarray, "2 pair"]
    decel: Float[np.ndarray, "2 pair"]

    @classmethod
    def of(cls, traffic: TrafficState) -> "GivingWay":
        """The pairs of some traffic; empty where the map has no right of way. The ego never gives way here."""
        table, limits = priorities(traffic.road) or Priorities({}, {}), traffic.road.lane
        ways = [
            (
                table.links[one.lane],
                one.gives_way and index > 0,
                _JunctionPassage.of(index, user, one, limits[one.lane].speed_limit),
            )
            for index, user in enumerate(traffic.users)
            for one in user.path.crossings
            if one.lane in table.links
        ]
        at_junction = defaultdict[str, list[tuple[JunctionMovement, _JunctionPassage]]](list)
        for link, _, way in ways:
            at_junction[link.junction].append((link, way))
        pairs = [
            (mine, other)
            for link, gives_way, mine in ways
            if gives_way
            for foe, other in at_junction[link.junction]
            if mine.user != other.user and table.lets_pass(link, foe)
        ]
        users, *rest = np.array(pairs).reshape(-1, 2, len(_JunctionPassage._fields)).transpose(2, 1, 0)
        return cls(users.astype(int), *rest)

    def waits_m(
        self, along: Float[np.ndarray, " user"], speed: Float[np.ndarray, " user"], waiting: Bool[np.ndarray, " user"]
    ) -> Float[np.ndarray, " user"]:
        """The distance ahead [m] at which each has to wait for others; `FAR_M` where it need not.

        `along` is the distance [m] that each has driven since the begin; `waiting` marks those that wait now.
        """
        waits = np.full(len(along), FAR_M)
        if not self.users.size:
            return waits
        mine, other = self.users
        left, through = self.enters - along[self.users], self.leaves - along[self.users]
        comes_s, gone_s = self._times_s(left, through, speed[self.users])
        meets = (comes_s[0] <= gone_s[1]) & (comes_s[1] <= gone_s[0] + _CLEAR_S) & (through[1] > 0.0)
        can_stop = (left[0] > 0.0) & (left[0] >= stops_within(speed[mine], self.decel[0]))
        stops = meets & can_stop & ~(waiting[other] & (left[1] > 0.0))
        np.minimum.at(waits, mine[stops], left[0][stops])
        return waits

    def _times_s(self, left: np.ndarray, through: np.ndarray, speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The times at which they enter and have left [s]."""
        ahead = np.maximum(left, 0.0)
        enters = np.minimum(np.sqrt(speed**2 + 2.0 * self.accel * ahead), self.fastest)
        slowing_m = np.minimum(np.maximum(speed**2 - enters**2, 0.0) / (2.0 * _SLOWS), ahead)
        slows_s = (ahead - slowing_m) / np.maximum(speed, _LEAST_M_S) + 2.0 * slowing_m / np.maximum(
            speed + enters, _LEAST_M_S
        )
        gains_s = seconds_for(ahead, speed, self.accel, np.maximum(self.fastest, speed))
        comes_s = np.where(enters < speed, slows_s, gains_s)
        inside_s = seconds_for(np.maximum(through - ahead, 0.0), enters, self.accel, self.fastest)
        return comes_s, comes_s + inside_s
