"""Numbers that stages which cannot ask each other have to agree on: each stands here, once.

What is strictly clean is asked of a finished case on the host (`verdicts.clean`) and of every collision that a search
comes across on the device (`attacks.acceptance`).
"""

import numpy as np

STANDING_M_S = 0.5  # what is slower stands
ALONG_RAD = float(np.deg2rad(45.0))  # headings that differ by less run the same way

OFF_ROAD_M = 0.3  # a corner may be so far off the road: logged traffic cuts corners by as much
SWEPT_OFF_ROAD_M2 = 0.05  # and a body may sweep as much beyond that
SUB_STEPS = 5  # between two steps agents go in a straight line, looked at so often

MOVED_M = 1e-3  # off its log by more: the attack changed how it moves
REAR_FACE = 0.15  # share of the ego's length, from its rear end: who meets it there drives into its back
REAR_PART = 0.30  # the same for those who come from behind
FROM_BEHIND_S = 1.0  # before the contact they were still behind the ego

GRAVITY_M_S2 = 9.81
MOST_ACCEL_M_S2 = 0.8 * GRAVITY_M_S2  # braking and steering together: what tyres hold on dry asphalt
OVER_LIMIT = 1.2  # times the speed limit: what is no speeding
# [m/s] An attack lets these get no faster, unless their log is: an adult who runs, and the speed up to which the motor
# of a pedelec helps (25 km/h, Regulation (EU) 168/2013).
# Of a pedestrian, in any direction: twice what 99 % of the moving steps of recorded ones have (`verdicts.ordinary`).
MOST_WALKING_M_S2 = 2.0
STOOD_S = 1.0  # who has not moved for so long stands
MOST_SPEED_M_S = {"pedestrian": 3.0, "bicycle": 7.0}
ABOVE_LOG_M_S2 = 0.05 * GRAVITY_M_S2  # or so much more than the same road user's log
ACCEL_WINDOW_S = 0.3  # over which accelerations are taken: shorter peaks are noise of the tracks
RSS_RESPONSE_S = 0.5  # of a careful driver, and ...
RSS_BRAKE_M_S2 = 4.0  # ... how hard it brakes then, at least (Shalev-Shwartz, Shammah and Shashua 2017)

# Largest controls that the mirror lets any vehicle apply: full braking on dry road is about
# 8 m/s^2 and 0.3 1/m is a turning circle of 6.7 m, tighter than any car's.
ACCEL_LIMIT = 6.0  # [m/s^2]
CURVATURE_LIMIT = 0.3  # [1/m]
