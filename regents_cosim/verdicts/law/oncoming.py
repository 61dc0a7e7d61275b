"""Find places that belong to oncoming traffic alone: all lanes there run the other way.

Where lanes of both directions lie on each other (a narrow road drawn as one) no place is oncoming, as no centre line is
known there. Inside a junction ways of many directions cross: there only the ways that a road user may take itself
(`own`) count as running in its direction, and only those that lead against it by more than 120 degrees as oncoming.
"""

import numpy as np
from jaxtyping import Bool, Float

from regents_cosim.geometry.boxes import Boxes, Values
from regents_cosim.geometry.frames import wrap
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.verdicts.law.lane_pieces import lane_pieces

OTHER_WAY_RAD = np.deg2rad(90.0)
OTHER_WAY_INSIDE_RAD = np.deg2rad(120.0)
Own = frozenset[str] | None
_ALONG, _ACROSS = 8, 10  # samples along and across a body: each stands for 1.25 % of it


def oncoming(
    road: RoadMap, points: Float[np.ndarray, "*axes 2"], heading: Values, z: Values = 0.0, own: Own = None
) -> Bool[np.ndarray, "*axes"]:
    """Whether all lanes at points [m] lead against a heading [rad].

    `own` holds the ids of the lanes that the road user may take; None: unknown, so all ways through junctions count.
    """
    shape = points.shape[:-1]
    heading, z = (np.broadcast_to(values, shape).ravel() for values in (heading, z))
    at = lane_pieces(road).under(points.reshape(-1, 2), z)
    turn = np.abs(wrap(at.heading - heading[at.point]))
    inside = np.array([lane.junction and own is not None for lane in road.lanes], bool)[at.lane]
    allowed = np.array([own is None or lane.id in own for lane in road.lanes], bool)[at.lane]
    against = turn > np.where(inside, OTHER_WAY_INSIDE_RAD, OTHER_WAY_RAD)
    along = (turn <= OTHER_WAY_RAD) & (~inside | allowed)
    count = len(heading)
    found = (np.bincount(at.point, against, count) > 0) & (np.bincount(at.point, along, count) == 0)
    return found.reshape(shape)


def oncoming_share(road: RoadMap, boxes: Boxes, own: Own = None) -> Float[np.ndarray, "*axes"]:
    """The share (0 to 1) of each body on purely oncoming lanes, from 80 samples."""
    values = np.broadcast_arrays(*boxes)
    x, y, yaw, length, width, z = (np.ravel(one).astype(float) for one in values)
    share = np.zeros(x.size)
    near = np.flatnonzero(_near_other_way(road, Boxes(x, y, yaw, length, width, z)))
    if len(near):
        places = _places(*(one[near] for one in (x, y, yaw, length, width)))
        share[near] = oncoming(road, places, yaw[near, None], z[near, None], own).mean(axis=1)
    return share.reshape(np.shape(values[0]))


def _near_other_way(road: RoadMap, box: Boxes) -> Bool[np.ndarray, " box"]:
    """Which bodies may touch a lane of the other direction, from five points along the middle of each."""
    x, y, yaw, length, z = (np.asarray(values)[:, None] for values in (box.x, box.y, box.yaw, box.length, box.z))
    along = np.linspace(-0.5, 0.5, 5) * length
    middle = np.stack([x + along * np.cos(yaw), y + along * np.sin(yaw)], axis=-1)
    reach = 0.5 * float(np.max(box.width, initial=0.0))
    at = lane_pieces(road).under(middle.reshape(-1, 2), np.repeat(z, 5), reach)
    against = np.abs(wrap(at.heading - yaw[at.point // 5, 0])) > OTHER_WAY_RAD
    found = np.zeros(len(yaw), bool)
    found[at.point[against] // 5] = True
    return found


def _places(
    x: np.ndarray, y: np.ndarray, yaw: np.ndarray, length: np.ndarray, width: np.ndarray
) -> Float[np.ndarray, "box place 2"]:
    """The centres of cells that divide each body evenly."""
    along, across = np.meshgrid(*((np.arange(n) + 0.5) / n - 0.5 for n in (_ALONG, _ACROSS)))
    ahead, left = along.ravel() * length[:, None], across.ravel() * width[:, None]
    cos, sin = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    return np.stack([x[:, None] + ahead * cos - left * sin, y[:, None] + ahead * sin + left * cos], axis=-1)
