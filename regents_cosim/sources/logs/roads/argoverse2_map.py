"""The vector map of Argoverse 2 (`log_map_archive_*.json`): lanes between two bounds, drivable areas, crossings."""

from pathlib import Path

import msgspec
import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.checks.typed_values import from_json
from regents_cosim.errors import LogError
from regents_cosim.sources.logs.files.text import as_utf8
from regents_cosim.sources.logs.formats import explained, unpacked
from regents_cosim.sources.logs.roads.road import centre_line, lanelet, largest
from regents_cosim.sources.logs.scene import LoggedLane, LoggedMap, with_openings


class _Point(msgspec.Struct, gc=False):
    x: float
    y: float
    z: float = 0.0


class _Segment(msgspec.Struct):
    id: int
    lane_type: str
    left_lane_boundary: list[_Point]
    right_lane_boundary: list[_Point]
    successors: list[int] = []
    left_neighbor_id: int | None = None
    right_neighbor_id: int | None = None
    is_intersection: bool = False


class _Area(msgspec.Struct):
    area_boundary: list[_Point]


class _Crossing(msgspec.Struct):
    edge1: list[_Point]
    edge2: list[_Point]


class _Map(msgspec.Struct):
    lane_segments: dict[str, _Segment]
    drivable_areas: dict[str, _Area]
    pedestrian_crossings: dict[str, _Crossing] | None = None


def read_map(folder: Path) -> LoggedMap:
    """The map of a scenario or log. Raises LogError where it is missing or damaged."""
    found = sorted([*folder.glob("log_map_archive_*.json"), *folder.glob("map/log_map_archive_*.json")])
    if not found:
        raise LogError(f"{folder}: no map (expected log_map_archive_*.json beside the tracks or in map/)")
    with explained(found[0], "Argoverse 2 map"):
        content = from_json(as_utf8(unpacked(found[0])), _Map)
        lanes = [_lane(s, content) for s in content.lane_segments.values() if s.lane_type != "BIKE"]
        areas = [largest(_xy(area.area_boundary)) for area in content.drivable_areas.values()]
        return LoggedMap(
            with_openings(tuple(lane for lane in lanes if lane is not None)),
            (),
            tuple(area for area in areas if isinstance(area, shapely.Polygon)),
            _crossings(content),
        )


def _crossings(content: _Map) -> tuple[shapely.Polygon, ...] | None:
    if content.pedestrian_crossings is None:
        return None
    sides = [(_xy(one.edge1), _xy(one.edge2)) for one in content.pedestrian_crossings.values()]
    found = (lanelet(*pair) for pair in sides if min(map(len, pair)) > 1)
    return tuple(area for area in found if area is not None)


def _lane(segment: _Segment, road: _Map) -> LoggedLane | None:
    left, right = _xy(segment.left_lane_boundary), _xy(segment.right_lane_boundary)
    if len(left) < 2 or len(right) < 2:
        return None
    centre, width = centre_line(left, right)
    return LoggedLane(
        id=str(segment.id),
        centre=centre,
        width=width,
        exits=tuple(str(name) for name in segment.successors),
        left=_beside(segment.left_neighbor_id, road, centre),
        right=_beside(segment.right_neighbor_id, road, centre),
        junction=segment.is_intersection,
    )


def _beside(name: int | None, road: _Map, centre: np.ndarray) -> str | None:
    """The name of the neighbouring lane if it runs the same way (the format lists oncoming lanes too), else None."""
    other = road.lane_segments.get(str(name))
    if other is None or len(other.left_lane_boundary) < 2:
        return None
    line = _xy([other.left_lane_boundary[end] for end in (0, -1)])
    return str(other.id) if float((line[-1] - line[0]) @ (centre[-1] - centre[0])) > 0.0 else None


def _xy(points: list[_Point]) -> Float[np.ndarray, "point 2"]:
    return np.array([(point.x, point.y) for point in points], float).reshape(-1, 2)
