"""Where the ways of others cross or join a route, and who gives way there."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.geometry.boxes import same_level
from regents_cosim.geometry.frames import wrap
from regents_cosim.maps.levels import height_on
from regents_cosim.maps.right_of_way import priorities
from regents_cosim.maps.roadmap import Approach, Lane, RoadMap
from regents_cosim.routes.sign_priority import WayIn, turns_across, waits_by_signs


@dataclass(frozen=True)
class Meeting:
    """A way of others that crosses or joins the route."""

    kind: Literal["crossing", "merge", "pedestrians"]
    lane: str  # the route's lane
    other: str  # the lane, or the crossing for pedestrians, of the others
    begin_m: float  # where along the route their lane is first reached ...
    end_m: float  # ... and where it is left behind; of a merge, where both lanes end
    # whether the ego gives way to them: by SUMO's `request` rows, on other maps by signs and turns; None: not told
    ego_yields: bool | None
    they_yield: bool | None  # whether they give way to the ego


class WayMet(NamedTuple):
    """A lane of others that crosses or joins a lane of the route."""

    kind: Literal["crossing", "merge"]
    lane: str
    other: str
    shared: Float[np.ndarray, "point 2"]  # [m] corners of the part of the lane that the other's strip covers
    ego_yields: bool | None  # as in `Meeting`
    they_yield: bool | None


def meetings(
    road: RoadMap, points: Float[np.ndarray, "point 2"], lanes: Sequence[tuple[str, float]]
) -> tuple[Meeting, ...]:
    """The meetings on a route with these lanes, each with the distance [m] where the route enters it, in order."""
    line, found = shapely.LineString(points), list[Meeting]()
    for met in ways_met(road, tuple(name for name, _ in lanes)):
        along = shapely.line_locate_point(line, shapely.points(met.shared))
        stretch = float(along.min()), float(along.max())
        found.append(Meeting(met.kind, met.lane, met.other, *stretch, met.ego_yields, met.they_yield))
    for name, begin in lanes:
        found += _on_foot(road, line, road.lane[name], begin)
    return tuple(sorted(found, key=lambda one: (one.begin_m, one.other)))


@lru_cache(maxsize=64)  # attacks in a simulation that runs ask again and again
def ways_met(road: RoadMap, lanes: tuple[str, ...]) -> tuple[WayMet, ...]:
    """The lanes of others that cross or join any of the `lanes` of a route."""
    found = list[WayMet]()
    for name in lanes:
        lane = road.lane[name]
        piece = lane.line
        for index in road.centre_lines.query(piece.buffer(0.5 * lane.width), predicate="intersects").tolist():
            other = road.lanes[index]
            kind = meeting_kind(road, lane, other) if other.id not in lanes else None
            if kind is not None and len(shared := _shared(piece, lane, other)):
                found.append(WayMet(kind, name, other.id, shared, *_yields(road, name, other.id)))
    return tuple(found)


def meeting_kind(road: RoadMap, lane: Lane, other: Lane) -> Literal["crossing", "merge"] | None:
    """How another lane meets one of the route; None for neighbours, and for lanes before, after and forking off it."""
    mine, theirs = ({link.target for link in road.exits[one.id]} for one in (lane, other))
    if other.id in (lane.left, lane.right) or lane.id in theirs or other.id in mine:
        return None
    if mine & theirs:
        return "merge"
    crossing = lane.line.intersection(other.line)
    if crossing.is_empty or _touch_at_an_end(lane, other):
        return None
    place = np.array(crossing.centroid.coords)
    return "crossing" if same_level(height_on(lane, place), height_on(other, place)).all() else None


def _touch_at_an_end(lane: Lane, other: Lane) -> bool:
    ends = lane.centre[[0, 0, -1, -1]] - other.centre[[0, -1, 0, -1]]
    return bool((np.hypot(*ends.T) < 0.1).any())


def _shared(piece: shapely.LineString, lane: Lane, other: Lane) -> Float[np.ndarray, "point 2"]:
    """The corners of the part of a lane's centre line on which the strips of both lanes overlap."""
    strip = other.line.buffer(0.5 * other.width, cap_style="flat")
    return shapely.get_coordinates(piece.intersection(shapely.buffer(strip, 0.5 * lane.width)))


def _yields(road: RoadMap, lane: str, other: str) -> tuple[bool | None, bool | None]:
    table = priorities(road)
    if table is None:
        return _by_signs(road, lane, other)
    if not {lane, other} <= table.links.keys():
        return None, None
    return table.must_yield(lane, other), table.must_yield(other, lane)


def _by_signs(road: RoadMap, lane: str, other: str) -> tuple[bool | None, bool | None]:
    """Who gives way by signs and turns; where there are lights, only by turns."""
    if other not in road.lane:
        return None, None
    lit = any(link.signal for name in (lane, other) for link in road.entries[name])
    waits = (turns_across if lit else waits_by_signs)(_way_in(road, lane), _way_in(road, other))
    return (None, None) if waits is None else (waits == "first", waits == "second")


def _way_in(road: RoadMap, name: str) -> WayIn:
    lane = road.lane[name]
    first, last = (np.arctan2(*(lane.centre[end + 1] - lane.centre[end])[::-1]) for end in (0, -2))
    signs: set[Approach | None] = {road.lane[link.source].approach for link in road.entries[name]}
    sign = lane.approach or (signs.pop() if len(signs) == 1 else None)
    begin = float(lane.centre[0, 0]), float(lane.centre[0, 1])
    return WayIn(float(first), float(wrap(last - first)), begin, sign)


def _on_foot(road: RoadMap, line: shapely.LineString, lane: Lane, begin: float) -> Iterator[Meeting]:
    """The crossings for pedestrians on a lane of the route."""
    for way in road.walkways:
        if way.kind == "crossing" and way.area.intersects(lane.line):
            inside = shapely.intersection(line, way.area)
            along = np.atleast_1d(shapely.line_locate_point(line, shapely.points(shapely.get_coordinates(inside))))
            if len(along) and along.max() >= begin:
                stretch = float(along.min()), float(along.max())
                yield Meeting("pedestrians", lane.id, way.id, *stretch, *_yields(road, lane.id, way.id))
