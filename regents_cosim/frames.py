"""The only place where coordinates change convention.

Inside: metres, x east, y north, box centre, yaw in radians counter-clockwise from +x.
SUMO: the same plane, but the front bumper's centre and degrees clockwise from north.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

Values = Float[np.ndarray, "..."] | float


class Pose(NamedTuple):
    """Box centre [m] and yaw [rad, counter-clockwise from +x]."""

    x: Values
    y: Values
    yaw: Values


class SumoPose(NamedTuple):
    """Front bumper centre [m] and navigation angle [degrees clockwise from north]."""

    x: Values
    y: Values
    angle: Values


def from_sumo(pose: SumoPose, length: Values) -> Pose:
    """Centre pose of a vehicle of `length` [m] that SUMO reports at `pose`; yaw in (-pi, pi]."""
    yaw = wrap(np.deg2rad(90.0 - pose.angle))
    half = 0.5 * length
    return Pose(pose.x - half * np.cos(yaw), pose.y - half * np.sin(yaw), yaw)


def to_sumo(pose: Pose, length: Values) -> SumoPose:
    """What SUMO calls the pose of a vehicle of `length` [m]; angle in [0, 360)."""
    half = 0.5 * length
    angle = np.mod(90.0 - np.rad2deg(pose.yaw), 360.0)
    return SumoPose(pose.x + half * np.cos(pose.yaw), pose.y + half * np.sin(pose.yaw), angle)


def wrap(angle: Values) -> Values:
    """The same direction in (-pi, pi] [rad]."""
    return np.pi - np.mod(np.pi - angle, 2.0 * np.pi)
