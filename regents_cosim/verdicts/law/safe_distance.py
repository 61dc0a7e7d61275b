"""The distance at which a follower never touches a leader that brakes, by RSS.

Source: Responsibility-Sensitive Safety (Shalev-Shwartz, Shammah and Shashua 2017, "On a formal model of safe and
scalable self-driving cars").
"""

from dataclasses import dataclass

from regents_cosim.norms.limits import RSS_BRAKE_M_S2, RSS_RESPONSE_S


@dataclass(frozen=True)
class SafeDistance:
    """RSS's parameters: reaction time and accelerations to be expected of a careful driver."""

    response_s: float = RSS_RESPONSE_S  # how long the follower may keep accelerating before it brakes
    accel: float = 2.0  # [m/s^2] of the follower during that time
    brake: float = RSS_BRAKE_M_S2  # [m/s^2] of the follower, at least
    hardest_brake: float = 8.0  # [m/s^2] of the leader


def safe_distance(follower: float, leader: float, limits: SafeDistance = SafeDistance()) -> float:
    """The gap [m] that a follower needs at these speeds [m/s] never to touch a leader that brakes its hardest.

    Source: RSS, Definition 1 and Lemma 2: v t + a t^2 / 2 + (v + a t)^2 / (2 b) - w^2 / (2 c), at least 0, with the
    response time t, the follower's speed v, acceleration a and braking b, the leader's speed w and braking c.
    """
    t, gained = limits.response_s, follower + limits.response_s * limits.accel
    way = follower * t + 0.5 * limits.accel * t**2 + gained**2 / (2.0 * limits.brake)
    return max(way - leader**2 / (2.0 * limits.hardest_brake), 0.0)
