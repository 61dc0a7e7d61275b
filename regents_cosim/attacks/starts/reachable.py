"""Bounds of where a candidate can be at each step, which rule out drives that come too late or too early.

The bounds hold for every profile of `speed_profiles`, on any line: no profile gets faster, or accelerates or brakes
harder.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float

from regents_cosim.attacks.starts.drive_lines import SMOOTHED_M, SPACING_M, ContactRange, DriveLine
from regents_cosim.attacks.starts.meeting import MeetingPair
from regents_cosim.attacks.starts.speed_profiles import fastest_wanted
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.verdicts.ordinary import DrivingLimits

_ROUNDED_M = 1.0  # along a line: its length differs from that of the drive by rounding
_EARLIER_S = 0.2  # contacts are marked at points of lines, and drives pass between them


@dataclass(frozen=True, eq=False)
class Reachable:
    """Bounds of the position of a vehicle that enters with a given speed and acceleration."""

    speed: float  # [m/s]
    accel: float  # [m/s^2]
    fastest_logged: float  # [m/s]
    limits: DrivingLimits
    times: Float[np.ndarray, " time"]  # [s] since its entry

    def near(
        self, pair: MeetingPair, road: RoadMap, begin: tuple[float, float], earliest_s: float
    ) -> ContactRange | None:
        """The positions of the ego at times when the vehicle, which enters at `begin` [m], may be there as well.

        None where there are none from `earliest_s` [s] on.
        """
        x, y, _ = pair.own
        most = np.maximum(self.along(np.inf)[1], self.along(_highest_limit(road))[1])
        away = np.hypot(x - begin[0], y - begin[1])
        may = pair.there & (away <= most + pair.reach_m + SMOOTHED_M) & (self.times >= earliest_s - _EARLIER_S)
        return ContactRange.to(x[may], y[may], pair.reach_m) if may.any() else None

    def touched(self, line: DriveLine, pair: MeetingPair, earliest_s: float) -> Bool[np.ndarray, "point time"]:
        """The points of a line, as far as the vehicle gets, at which it may touch the ego at each step."""
        least, most = self.along(line.limit)
        points = line.points[: int(most[-1] / SPACING_M) + 2]
        along = np.arange(len(points))[:, None] * SPACING_M
        may = (along >= least) & (along <= most) & (self.times >= earliest_s - _EARLIER_S)
        return pair.touch(points[:, :1], points[:, 1:], line.heading[: len(points), None], may)

    def along(self, limit: float) -> tuple[Float[np.ndarray, " time"], Float[np.ndarray, " time"]]:
        """The least and the greatest distance [m] along a line with the speed limit `limit` [m/s]."""
        fastest = max(fastest_wanted(limit, self.fastest_logged), self.speed)
        # Its initial acceleration ends only as the jerk allows, even if it is fast enough already.
        gained = max(self.accel, 0.0) * (max(self.accel, 0.0) / self.limits.jerk + 1.0)
        hardest, braking = max(self.limits.accel, self.accel), max(self.limits.braking, -self.accel)
        least, most = travelled(self.times, self.speed, fastest + gained, hardest, braking)
        return least - _ROUNDED_M, most + _ROUNDED_M


def travelled(
    times: Float[np.ndarray, " time"], speed: float, fastest: float, accel: float, braking: float
) -> tuple[Float[np.ndarray, " time"], Float[np.ndarray, " time"]]:
    """The least distance [m], with `braking` from `speed`, and the greatest, with `accel` up to `fastest`."""
    gains_s, brakes_s = np.minimum(times, (fastest - speed) / accel), np.minimum(times, speed / braking)
    least = speed * brakes_s - 0.5 * braking * brakes_s**2
    return least, speed * times + accel * gains_s * (times - 0.5 * gains_s)


@lru_cache(maxsize=16)  # a city has thousands of lanes, and every candidate asks
def _highest_limit(road: RoadMap) -> float:
    return max((lane.speed_limit for lane in road.lanes if np.isfinite(lane.speed_limit)), default=0.0)
