"""Builds a RoadMap from what a log says about the road.

The drivable area is the first that the log allows of: the area enclosed by oriented kerbs; the union of areas and
lanelets; the places where motor vehicles drove, widened. Maps of logs are cropped, and the outline of a cropped area
runs across the road at its end, without being a kerb. So where a lane begins or ends at the end of the map without a
kerb in its way, the area goes on straight for 30 m.
"""

import re
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import shapely
from jaxtyping import Float
from shapely.geometry.base import BaseGeometry

from regents_cosim.errors import InputError, LogError
from regents_cosim.geometry.areas import closed, require_few_crossings, united
from regents_cosim.geometry.lines import distances_along, end_direction, points_at
from regents_cosim.maps.roadmap import Connection, Lane, RoadMap
from regents_cosim.maps.walkways import Walkway
from regents_cosim.scenario.scenario import VEHICLE_KINDS
from regents_cosim.sources.logs.scene import LoggedLane, LoggedMap, LoggedScene, LoggedSignal, Track
from regents_cosim.sources.logs.waymo_codes import MPH

_CLOSE_M = 0.2  # gaps between areas up to twice as wide belong to the road
_BEYOND_M = 30.0  # length of the road beyond the end of the map
_LOOK_M = 6.0  # a kerb within this distance means that a lane really ends
_WIDEN_M = 2.0  # to either side of the places where vehicles drove
_LANE_WIDTHS_M = (2.0, 8.0)
KMH = 1.0 / 3.6  # [m/s]
_LONGEST_SPEED = 40  # characters
NO_MAP = "the log has no road: the drivable area is where its motor vehicles drove, 2 m to either side"


def build_road(scene: LoggedScene) -> RoadMap:
    """The map of `scene`. Raises LogError where neither map nor traffic shows a road."""
    lanes = tuple(lane for lane in scene.road.lanes if _has_direction(lane))
    try:
        area = drivable_area(scene.road, scene.tracks)
    except (shapely.errors.ShapelyError, InputError) as error:
        raise LogError(f"{scene.name}: the road cannot be put together ({error})") from error
    if area.is_empty:
        raise LogError(f"{scene.name}: neither a road nor a moving vehicle (expected at least one of them)")
    known = {lane.id for lane in lanes}
    return RoadMap(
        lanes=tuple(_lane(lane, known) for lane in lanes),
        connections=tuple(_connections(lanes, known, scene.signals)),
        drivable=area,
        crossings=_crossings(scene.road),
    )


def drivable_area(road: LoggedMap, tracks: Iterable[Track]) -> BaseGeometry:
    """The drivable area; empty if the log does not show one."""
    if road.edges:
        from regents_cosim.sources.logs.roads.edges import area_inside  # imports SciPy, which takes half a second

        area = area_inside(road.edges, road.lanes)
    elif road.areas:
        valid = [area for area in road.areas if area.is_valid]
        require_few_crossings(valid)
        area = closed(shapely.union_all(valid), _CLOSE_M)
    else:
        return _swept(tracks)
    beyond = list(_beyond(road, area))
    require_few_crossings(beyond)
    parts = shapely.get_parts(shapely.union_all([area, *beyond]))
    return shapely.MultiPolygon([part for part in parts if part.geom_type == "Polygon"])


def crossings_of(outlines: Iterable[Float[np.ndarray, "_point _axis"]]) -> tuple[shapely.Polygon, ...]:
    """The areas of crossings with these outlines [m]; those without an area are left out."""
    known = (outline[:, :2] for outline in outlines if np.isfinite(outline[:, :2]).all())
    return tuple(area for area in map(largest, known) if area is not None)


def _crossings(road: LoggedMap) -> tuple[Walkway, ...] | None:
    """The crossings; one walks along the longer side."""
    if road.crossings is None:
        return None
    found = []
    for number, area in enumerate(road.crossings):
        ring = shapely.get_coordinates(shapely.minimum_rotated_rectangle(area))
        one, two = (float(np.hypot(*(ring[k + 1] - ring[k]))) for k in (0, 1))
        first, second = ring[:4], ring[1:5]
        ends = 0.5 * (first + second)[[1, 3] if one >= two else [0, 2]]
        found.append(Walkway(f"crossing{number}", "crossing", ends, min(one, two)))
    return tuple(found)


def lanelet(left: Float[np.ndarray, "a 2"], right: Float[np.ndarray, "b 2"]) -> shapely.Polygon | None:
    """The area between two bounds, either of which may run backwards; None where it is empty."""
    return largest(np.concatenate([left, right[::-1] if run_alike(left, right) else right]))


def run_alike(left: Float[np.ndarray, "a 2"], right: Float[np.ndarray, "b 2"]) -> bool:
    """Whether two bounds of a lane run in the same direction."""
    straight = np.hypot(*(left[0] - right[0])) + np.hypot(*(left[-1] - right[-1]))
    crossed = np.hypot(*(left[0] - right[-1])) + np.hypot(*(left[-1] - right[0]))
    return bool(straight <= crossed)


def centre_line(
    left: Float[np.ndarray, "a 2"], right: Float[np.ndarray, "b 2"]
) -> tuple[Float[np.ndarray, "point 2"], float]:
    """The line midway between two bounds, and their median distance [m], at least that of a lane for cars."""
    parts = np.linspace(0.0, 1.0, max(len(left), len(right)))
    ways = distances_along(*left.T), distances_along(*right.T)
    one, two = (points_at(parts * way[-1], way, side) for way, side in zip(ways, (left, right), strict=True))
    return 0.5 * (one + two), max(float(np.median(np.hypot(*(one - two).T))), _LANE_WIDTHS_M[0])


def largest(ring: Float[np.ndarray, "point 2"]) -> shapely.Polygon | None:
    """A ring as a valid polygon, the largest part where it crosses itself; None where its area is 0."""
    if len(ring) < 3:
        return None
    polygon = shapely.Polygon(ring)
    require_few_crossings([polygon])
    parts = [p for p in shapely.get_parts(shapely.make_valid(polygon)) if p.geom_type == "Polygon"]
    best = max(parts, key=lambda part: part.area, default=None)
    return best if best is not None and best.area > 1e-3 else None


def _swept(tracks: Iterable[Track]) -> BaseGeometry:
    ways = []
    for track in tracks:
        if track.agent.kind in VEHICLE_KINDS:
            pieces = np.split(np.column_stack([track.x, track.y]), np.flatnonzero(np.diff(track.step) != 1) + 1)
            ways += [shapely.LineString(piece) for piece in pieces if len(piece) > 1]
    return united(np.asarray(shapely.buffer(shapely.simplify(ways, 0.2), _WIDEN_M, quad_segs=3)).tolist())


# --- where the map ends -----------------------------------------------------------------------


def _beyond(road: LoggedMap, area: BaseGeometry) -> Iterator[shapely.Polygon]:
    """Strips that extend the road where lanes begin or end at the end of the map."""
    kerbs = shapely.STRtree([shapely.LineString(edge.points) for edge in road.edges])
    shapely.prepare(area)
    for lane in filter(_has_direction, road.lanes):
        ends = [(lane.centre, lane.open_end), (lane.centre[::-1], lane.open_start)]
        for points in (points for points, is_open in ends if is_open):
            end, ahead = points[-1], end_direction(points)
            look = shapely.LineString([end, end + _LOOK_M * ahead])
            outside = not shapely.contains_xy(area, *(end + _LOOK_M * ahead))
            if outside and not len(kerbs.query(look, predicate="intersects")):
                strip = shapely.LineString([end - ahead, end + _BEYOND_M * ahead])
                yield strip.buffer(0.5 * _width(lane), cap_style="flat")


# --- lanes ------------------------------------------------------------------------------------


def _has_direction(lane: LoggedLane) -> bool:
    return float(np.hypot(*(lane.centre - lane.centre[0]).T).max()) > 1e-3


def _width(lane: LoggedLane) -> float:
    return float(np.clip(lane.width, *_LANE_WIDTHS_M))


def _lane(lane: LoggedLane, known: set[str]) -> Lane:
    return Lane(
        id=lane.id,
        centre=lane.centre,
        width=_width(lane),
        speed_limit=float(lane.speed_limit),
        junction=lane.junction,
        left=lane.left if lane.left in known else None,
        right=lane.right if lane.right in known else None,
        approach=lane.approach,
    )


def _connections(lanes: Sequence[LoggedLane], known: set[str], signals: Sequence[LoggedSignal]) -> Iterator[Connection]:
    """The connections of lanes to their exits, each with the signal in front of it."""
    before = {name: light.id for light in signals if light.at_start for name in light.lanes}
    behind = {name: light.id for light in signals if not light.at_start for name in light.lanes}
    for lane in lanes:
        for name in dict.fromkeys(lane.exits):
            if name in known:
                yield Connection(lane.id, name, behind.get(lane.id) or before.get(name))


_NUMBER_AND_UNIT = re.compile(r"\s*(\d+\.?\d*)\s*([a-z/]*)\s*", re.IGNORECASE)


def speed_of(text: str, plain: float) -> float:
    """A speed such as `50 km/h`, `50kmh` or `25 mph` [m/s]; a bare number counts in units of `plain` [m/s].

    Raises ValueError for anything else.
    """
    known = {"": plain, "kmh": KMH, "km/h": KMH, "kph": KMH, "mph": MPH, "m/s": 1.0}
    found = _NUMBER_AND_UNIT.fullmatch(text[:_LONGEST_SPEED])
    if found is None or found[2].lower() not in known:
        raise ValueError(f"{text[:_LONGEST_SPEED]!r} is no speed")
    return float(found[1]) * known[found[2].lower()]


# Markings between lanes that forbid a lane change, in the terms of CommonRoad and lanelet2. Both call a solid line with
# a dashed one on its right `solid_dashed`: one may cross it from the dashed side.
_BINDS = {"solid", "curb"}
_WALLS = {"curbstone", "wall", "fence", "guard_rail", "road_border", "jersey_barrier", "rail", "keepout"}


def may_cross(marking: str, to_left: bool) -> bool:
    """Whether a marking such as `broad_solid` or `dashed_solid` may be crossed to the left (`to_left`) or right."""
    words = marking.removeprefix("broad_").removeprefix("lowered_").split("_")
    return words[-1 if to_left else 0] not in _BINDS


def may_cross_way(tags: dict[str, str], to_left: bool) -> bool:
    """Whether a lanelet2 way with these tags may be crossed; a tag about lane changes overrides the kind of line."""
    said = tags.get(f"lane_change:{'left' if to_left else 'right'}", tags.get("lane_change"))
    if said in ("yes", "no"):
        return said == "yes"
    return tags.get("type") not in _WALLS and may_cross(tags.get("subtype", ""), to_left)
