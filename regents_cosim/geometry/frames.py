"""Convert between the frames of SUMO, highway-env, logs and this package; nowhere else is a convention changed.

Inside: metres, x east, y north, box centre, yaw in radians counter-clockwise from +x.
SUMO: the same plane, but the centre of the front bumper and degrees clockwise from north.
highway-env: the box centre too, but y south (down on its screen) and angles from +x towards +y.
Logs: front bumpers, corners of boxes in images, latitude and longitude.
"""

from typing import Any, NamedTuple

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
    return from_front(pose.x, pose.y, wrap(np.deg2rad(90.0 - pose.angle)), length)


def to_sumo(pose: Pose, length: Values) -> SumoPose:
    """The pose of a vehicle of `length` [m] in SUMO's convention; angle in [0, 360)."""
    half = 0.5 * length
    angle = np.mod(90.0 - np.rad2deg(pose.yaw), 360.0)
    return SumoPose(pose.x + half * np.cos(pose.yaw), pose.y + half * np.sin(pose.yaw), angle)


class HighwayPose(NamedTuple):
    """Box centre [m, y south] and heading [rad, from +x towards +y: clockwise seen from above]."""

    x: Values
    y: Values
    heading: Values


def from_highway(pose: HighwayPose) -> Pose:
    """The pose [m, rad] of a vehicle that highway-env reports at `pose`; the yaw keeps its full turns."""
    return Pose(pose.x, np.negative(pose.y), np.negative(pose.heading))


def to_highway(pose: Pose) -> HighwayPose:
    """The pose in highway-env's convention, so that its left (lane 0) stays left."""
    return HighwayPose(pose.x, np.negative(pose.y), np.negative(pose.yaw))


def points_from_highway(points: Float[np.ndarray, "... 2"]) -> Float[np.ndarray, "... 2"]:
    """Points [m] of highway-env's plane in the package's plane."""
    return points * np.array([1.0, -1.0])


def points_to_highway(points: Float[np.ndarray, "... 2"]) -> Float[np.ndarray, "... 2"]:
    """Points [m] of the package's plane in highway-env's plane."""
    return points_from_highway(points)


def wheel_from_curvature(curvature: Values, length: Values) -> Values:
    """highway-env's steering angle [rad, positive to the right] for a `curvature` [1/m, positive turns left].

    highway-env turns a vehicle of `length` L [m] by v sin(beta) / (L / 2) per second, with the slip
    angle beta = arctan(tan(steering) / 2); the curvature is 2 sin(beta) / L, at most 2 / L.
    """
    slip = np.arcsin(np.clip(np.multiply(0.5 * np.asarray(length), curvature), -1.0, 1.0))
    return -np.arctan(2.0 * np.tan(slip))


def wrap(angle: Values) -> Values:
    """An angle [rad] brought into (-pi, pi], the direction unchanged."""
    return np.pi - np.mod(np.pi - angle, 2.0 * np.pi)


def ahead_and_left(xp: Any, dx: Any, dy: Any, yaw: Any) -> tuple[Any, Any]:
    """How far ahead and to the left [m] a place is that lies `dx` east and `dy` north [m], for who looks along `yaw`.

    `xp` is NumPy or JAX.
    """
    return along_and_left(dx, dy, xp.cos(yaw), xp.sin(yaw))


def along_and_left(dx: Any, dy: Any, cos: Any, sin: Any) -> tuple[Any, Any]:
    """The parts of a vector along a direction, which is given by its cosine and sine, and to its left."""
    return dx * cos + dy * sin, dy * cos - dx * sin


def from_front(x: Values, y: Values, yaw: Values, length: Values) -> Pose:
    """Centre pose of a vehicle of `length` [m] whose front bumper's centre is at x, y [m]."""
    half = 0.5 * length
    return Pose(x - half * np.cos(yaw), y - half * np.sin(yaw), yaw)


def from_image_corner(x: Values, y: Values, along_x: Values, along_y: Values) -> tuple[Values, Values]:
    """Centre [m] of an upright box given by its upper left corner in an image, whose y runs down."""
    return x + 0.5 * along_x, -(y + 0.5 * along_y)


FOOT_M = 0.3048

# WGS 84 and its third flattening; UTM scales by 0.9996 and puts its central meridian at 500 km.
_EQUATOR_M = 6378137.0
_FLATTENING = 1.0 / 298.257223563
_UTM_SCALE = 0.9996
_UTM_EAST_M = 500_000.0
_NEAR_DEG = 1e-4  # about 10 m


def from_lat_lon(latitude: Values, longitude: Values, zone: int) -> tuple[Values, Values]:
    """UTM easting and northing [m] (north of the equator, negative south of it) of WGS 84 degrees.

    Source: Krueger's series in the third flattening to the sixth order, as in Karney 2011,
    "Transverse Mercator with an accuracy of a few nanometers", eqs. 7 to 35.
    """
    n = _FLATTENING / (2.0 - _FLATTENING)
    radius = _EQUATOR_M / (1.0 + n) * (1.0 + n**2 / 4.0 + n**4 / 64.0 + n**6 / 256.0)
    series = (
        n / 2 - 2 * n**2 / 3 + 5 * n**3 / 16 + 41 * n**4 / 180 - 127 * n**5 / 288 + 7891 * n**6 / 37800,
        13 * n**2 / 48 - 3 * n**3 / 5 + 557 * n**4 / 1440 + 281 * n**5 / 630 - 1983433 * n**6 / 1935360,
        61 * n**3 / 240 - 103 * n**4 / 140 + 15061 * n**5 / 26880 + 167603 * n**6 / 181440,
        49561 * n**4 / 161280 - 179 * n**5 / 168 + 6601661 * n**6 / 7257600,
        34729 * n**5 / 80640 - 3418889 * n**6 / 1995840,
        212378941 * n**6 / 319334400,
    )
    phi = np.deg2rad(latitude)
    away = np.deg2rad(longitude - (6.0 * zone - 183.0))
    eccentricity = 2.0 * np.sqrt(n) / (1.0 + n)
    tau = np.sinh(np.arctanh(np.sin(phi)) - eccentricity * np.arctanh(eccentricity * np.sin(phi)))
    xi, eta = np.arctan2(tau, np.cos(away)), np.arcsinh(np.sin(away) / np.hypot(tau, np.cos(away)))
    north = xi + sum(a * np.sin(2 * j * xi) * np.cosh(2 * j * eta) for j, a in enumerate(series, 1))
    east = eta + sum(a * np.cos(2 * j * xi) * np.sinh(2 * j * eta) for j, a in enumerate(series, 1))
    return _UTM_EAST_M + _UTM_SCALE * radius * east, _UTM_SCALE * radius * north


def north_of(latitude: Values, longitude: Values, zone: int) -> Values:
    """The direction of true north in the plane of `from_lat_lon` [rad, counter-clockwise from +y].

    Away from the zone's central meridian it is not +y: at its edge by up to 3 degrees times the sine of the latitude.
    """
    (x0, y0), (x1, y1) = (from_lat_lon(latitude + away, longitude, zone) for away in (-_NEAR_DEG, _NEAR_DEG))
    return np.arctan2(x0 - x1, y1 - y0)
