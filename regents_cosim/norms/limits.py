"""Thresholds that stages share although they do not import each other.

`verdicts.clean` applies them on the host to a finished case, `attacks.accept.acceptance` on the device to every
collision that a search comes across.
"""

from typing import Any

import numpy as np

ASSUMED_LIMIT_M_S = 13.9  # 50 km/h, of lanes of logs whose map names no speed limit
STANDING_M_S = 0.5  # an agent below this speed counts as standing
ALONG_RAD = float(np.deg2rad(45.0))  # headings that differ by less run the same way, ...
SAME_WAY_COS = np.float32(np.cos(ALONG_RAD))  # ... and so do directions with a greater cosine between them
AGAINST_RAD = float(np.deg2rad(135.0))  # headings that differ by more run against each other
ONCOMING_SHARE = 0.17  # of a body on oncoming lanes: 0.3 m of a car 1.8 m wide, ...
ONCOMING_STEPS = 2  # ... for so many steps
HEAD_ON_SHARE = 0.05  # the same share in a head-on collision

OFF_ROAD_M = 0.3  # how far off the road a corner of a box may be: vehicles in logs cut corners by as much
SWEPT_OFF_ROAD_M2 = 0.05  # area beyond that margin that a body may sweep
SUB_STEPS = 5  # instants between two steps at which boxes are compared; agents move in a straight line in between

MOVED_M = 1e-3  # an agent further than this from its log counts as changed by the attack
REAR_FACE = 0.15  # share of the ego's length, from its rear end: an agent that touches it there runs into its back
REAR_PART = 0.30  # the same share for agents that come from behind
FROM_BEHIND_S = 1.0  # how long before the contact they must still have been behind the ego

GRAVITY_M_S2 = 9.81
MOST_ACCEL_M_S2 = 0.8 * GRAVITY_M_S2  # limit of braking and steering together: the grip of tyres on dry asphalt
OVER_LIMIT = 1.2  # times the speed limit: no speeding up to there
# Greatest acceleration of a pedestrian in any direction: twice what 99 % of the moving steps of recorded pedestrians
# stay below (`verdicts.ordinary`).
MOST_WALKING_M_S2 = 2.0
STOOD_S = 1.0  # an agent that has not moved for so long counts as standing
# An attack makes no agent faster than this, unless its log is: the speed of a running adult, and the speed up to which
# the motor of a pedelec helps (25 km/h, Regulation (EU) 168/2013).
MOST_SPEED_M_S = {"pedestrian": 3.0, "bicycle": 7.0}
ABOVE_LOG_M_S2 = 0.05 * GRAVITY_M_S2  # or so much more than in the same road user's log
ACCEL_WINDOW_S = 0.3  # window over which accelerations are averaged: shorter peaks are noise of the tracks
RSS_RESPONSE_S = 0.5  # reaction time of a careful driver, and ...
RSS_BRAKE_M_S2 = 4.0  # ... the deceleration with which it brakes at least (Shalev-Shwartz, Shammah and Shashua 2017)
RSS_ACCEL_M_S2 = 2.0  # of a follower, until it reacts
RSS_HARDEST_BRAKE_M_S2 = 8.0  # of a leader
INTRUSION_M = 0.3  # UN R157, 5.2.5.2: so far beyond its marking a body intrudes into a lane, ...
CUT_IN_BRAKE_M_S2 = 6.0  # ... and a TTC below v_rel / (2 * 6 m/s^2) + 0.35 s leaves no room to react
CUT_IN_S = 0.35
LANE_CHANGE_S = 5.0  # UN R79, 5.6.4.6: a change of lanes, from one marking to the other, is over sooner

# Largest controls that the mirror lets any vehicle apply: the full braking of the careful driver of UN R157, so that no
# planner crashes only because its brakes are weaker, and a turning circle of 6.7 m, tighter than any car's.
ACCEL_LIMIT = 0.774 * GRAVITY_M_S2  # [m/s^2]
CURVATURE_LIMIT = 0.3  # [1/m]

_NEAREST = 0.499


def steps_of(xp: Any, seconds: float, dt: Any) -> Any:
    """The nearest number of steps of `dt` [s]; halves are rounded down, so host and device agree on them.

    `xp` is NumPy or jax.numpy, whose single precision makes a half of what is slightly less in double precision.
    """
    return xp.floor(seconds / dt + _NEAREST).astype(int)


def safe_distance(follower: float, leader: float) -> float:
    """The gap [m] that a follower needs at these speeds [m/s] never to touch a leader that brakes its hardest.

    Source: Responsibility-Sensitive Safety (Shalev-Shwartz, Shammah and Shashua 2017, "On a formal model of safe and
    scalable self-driving cars"), Definition 1 and Lemma 2: v t + a t^2 / 2 + (v + a t)^2 / (2 b) - w^2 / (2 c), at
    least 0, with the response time t, the follower's speed v, acceleration a and braking b, the leader's w and c.
    """
    t, gained = RSS_RESPONSE_S, follower + RSS_RESPONSE_S * RSS_ACCEL_M_S2
    way = follower * t + 0.5 * RSS_ACCEL_M_S2 * t**2 + gained**2 / (2.0 * RSS_BRAKE_M_S2)
    return max(way - leader**2 / (2.0 * RSS_HARDEST_BRAKE_M_S2), 0.0)
