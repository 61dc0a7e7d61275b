"""Turns CommonRoad's shapes of obstacles into boxes that move with the obstacle.

A shape may be a group whose parts have centres and orientations of their own. An obstacle at p with heading a puts a
part's centre at p + centre and turns the part by a around it; polygons turn around their centroid. An `originXShift`
turns with the obstacle.

Source: `rotate_translate_local` of commonroad-io 2024.3, `RectObstacleShape` of 2026.1.
"""

import xml.etree.ElementTree as ET
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.geometry.frames import wrap
from regents_cosim.scenario.scenario import Kind
from regents_cosim.sources.logs.files.xml_files import number_of, point_of
from regents_cosim.sources.logs.scene import Track, agent_with_size

_FILLED = 0.95  # of its bounding box: a polygon with a smaller share is not a rectangle
_UPRIGHT = 1.0 + 1e-6  # times the area of the smallest box: up to this, the box along the axes is preferred


class ObstacleBox(NamedTuple):
    """One box of an obstacle, in the obstacle's coordinates."""

    length: float  # [m]
    width: float  # [m]
    centre: complex  # [m] offset that does not turn with the obstacle
    ahead: complex = 0.0  # [m] offset that turns with it
    turn: float = 0.0  # [rad]
    filled: bool = True  # the box is the shape itself, not only its bounding box

    def of(self, track: Track, name: str, kind: Kind) -> Track:
        """The track of this part's centre while the obstacle moves along `track`."""
        place = track.x + 1j * track.y + self.centre + self.ahead * np.exp(1j * track.yaw)
        agent = agent_with_size(name, kind, self.length, self.width)
        yaw = np.asarray(wrap(track.yaw + self.turn)) if self.turn else track.yaw
        return replace(track, agent=agent, x=place.real.copy(), y=place.imag.copy(), yaw=yaw)


def parts_of(shape: ET.Element | None) -> tuple[ObstacleBox, ...]:
    """The boxes of a shape; empty for an unknown shape."""
    found = (_part(element) for element in ([] if shape is None else shape))
    return tuple(part for part in found if part is not None)


def _part(element: ET.Element) -> ObstacleBox | None:
    if element.tag == "rectangle":
        turn = number_of(element.findtext("orientation") or "0")
        shift = -number_of(element.findtext("originXShift") or "0") * np.exp(1j * turn)
        size = number_of(element.findtext("length")), number_of(element.findtext("width"))
        return ObstacleBox(*size, _centre(element), complex(shift), turn)
    if element.tag == "circle":
        across = 2.0 * number_of(element.findtext("radius"))
        return ObstacleBox(across, across, _centre(element))
    corners = np.array([point_of(one) for one in element.findall("point")], float).reshape(-1, 2)
    return _around(corners) if element.tag == "polygon" and len(corners) > 2 else None


def _centre(element: ET.Element) -> complex:
    centre = element.find("center")
    return 0j if centre is None else complex(*point_of(centre))


def _around(corners: Float[np.ndarray, "corner 2"]) -> ObstacleBox:
    """The smallest box around a polygon; its length lies along the side that is nearer to straight ahead."""
    polygon = shapely.convex_hull(shapely.Polygon(corners))
    area = shapely.Polygon(corners)
    upright, smallest = shapely.envelope(polygon), shapely.oriented_envelope(polygon)
    box = upright if upright.area <= _UPRIGHT * smallest.area else smallest
    ring = shapely.get_coordinates(box)
    sides = np.diff(ring[:3], axis=0) if len(ring) > 3 else np.diff(ring[[0, -1, 0]], axis=0)
    along = sides[np.argmax(np.abs(sides[:, 0]) / np.maximum(np.hypot(*sides.T), 1e-9))]
    along = along if along[0] >= 0.0 else -along
    turn = float(np.arctan2(along[1], along[0]))
    local = (corners[:, 0] + 1j * corners[:, 1]) * np.exp(-1j * turn)
    middle = complex(np.ptp(local.real) / 2 + local.real.min(), np.ptp(local.imag) / 2 + local.imag.min())
    centroid = complex(area.centroid.x, area.centroid.y) if area.area > 0.0 else middle * np.exp(1j * turn)
    ahead = middle * np.exp(1j * turn) - centroid
    size = float(np.ptp(local.real)), float(np.ptp(local.imag))
    return ObstacleBox(*size, centroid, complex(ahead), turn, area.area >= _FILLED * size[0] * size[1])
