"""The only place where coordinates change convention.

Inside: metres, x east, y north, box centre, yaw in radians counter-clockwise from +x.
SUMO: the same plane, but the front bumper's centre and degrees clockwise from north.
highway-env: the box centre too, but y south (down on its screen) and angles from +x towards +y.
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


class HighwayPose(NamedTuple):
    """Box centre [m, y south] and heading [rad, from +x towards +y: clockwise seen from above]."""

    x: Values
    y: Values
    heading: Values


def from_highway(pose: HighwayPose) -> Pose:
    """Pose of what highway-env reports at `pose`; the yaw keeps its full turns."""
    return Pose(pose.x, np.negative(pose.y), np.negative(pose.heading))


def to_highway(pose: Pose) -> HighwayPose:
    """What highway-env calls a pose, so that its left (lane 0) stays left."""
    return HighwayPose(pose.x, np.negative(pose.y), np.negative(pose.yaw))


def points_from_highway(points: Float[np.ndarray, "... 2"]) -> Float[np.ndarray, "... 2"]:
    """Points [m] of highway-env's plane in ours."""
    return points * np.array([1.0, -1.0])


def points_to_highway(points: Float[np.ndarray, "... 2"]) -> Float[np.ndarray, "... 2"]:
    """Points [m] of our plane in highway-env's: the same mirroring."""
    return points_from_highway(points)


def wheel_from_curvature(curvature: Values, length: Values) -> Values:
    """highway-env's steering angle [rad, positive to the right] for a `curvature` [1/m, positive turns left].

    highway-env turns a vehicle of `length` L [m] by v sin(beta) / (L / 2) per second, with the slip
    angle beta = arctan(tan(steering) / 2); the curvature is 2 sin(beta) / L, at most 2 / L.
    """
    slip = np.arcsin(np.clip(np.multiply(0.5 * np.asarray(length), curvature), -1.0, 1.0))
    return -np.arctan(2.0 * np.tan(slip))


def curvature_from_wheel(steering: Values, length: Values) -> Values:
    """The inverse of `wheel_from_curvature`, for angles within a quarter turn."""
    slip = np.arctan(0.5 * np.tan(steering))
    return -2.0 * np.sin(slip) / length


def wrap(angle: Values) -> Values:
    """The same direction in (-pi, pi] [rad]."""
    return np.pi - np.mod(np.pi - angle, 2.0 * np.pi)
