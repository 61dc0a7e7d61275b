"""Where the ways of others cross or join a route, and who gives way there.

On maps without SUMO's rules of right of way that is by what signs tell along each way, by who turns across the other,
or by the right. Sources: Vienna Convention on Road Traffic (1968), art. 16(1)(b) (who turns lets oncoming traffic pass)
and 18 (intersections); Uniform Vehicle Code (2000), 11-402 (also oncoming traffic that turns into the same road).
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.geometry.boxes import same_level
from regents_cosim.geometry.frames import ahead_and_left, wrap
from regents_cosim.maps.levels import height_on
from regents_cosim.maps.right_of_way import priorities
from regents_cosim.maps.roadmap import Approach, Connection, Lane, RoadMap
from regents_cosim.maps.walkways import Walkway
from regents_cosim.norms.limits import ALONG_RAD
from regents_cosim.scenario.scenario import Signal

_AGAINST_RAD = np.pi - ALONG_RAD
TURNED_RAD = np.deg2rad(25.0)  # less is no turn
_SIDE_M = 1.0  # so far to one side of each other two pass
_RANK: dict[Approach | None, int] = {"priority": 2, None: 1, "right_first": 1, "yields": 0, "stops": 0}
_LIT_RANK = {"r": 0, "u": 0, "s": 1, "y": 2, "g": 2, "G": 3}  # by SUMO's letters; a light that is off tells nothing

Waiting = Literal["first", "second"]  # of two


class WayIn(NamedTuple):
    """How one of two ways leads to where they meet."""

    came_rad: float
    turned_rad: float  # along it, positive to the left
    begin: tuple[float, float]  # [m]
    sign: Approach | None = None


def first_if(condition: bool) -> Waiting:
    """The first of two where the condition holds, else the second."""
    return "first" if condition else "second"


def waits_by_signs(one: WayIn, two: WayIn) -> Waiting | None:
    """Who waits where the signs along both, or a turn across the other, tell; None: they do not tell."""
    ranks = _RANK[one.sign], _RANK[two.sign]
    if ranks[0] != ranks[1]:
        return first_if(ranks[0] < ranks[1])
    if one.sign == two.sign == "stops":
        return None  # the first to come goes first
    across = turns_across(one, two)
    return waits_for_right(one, two) if across is None and one.sign == two.sign == "right_first" else across


def waits_for_right(one: WayIn, two: WayIn) -> Waiting | None:
    """Of two whose ways cross, the one to whose right the other comes."""
    between = float(wrap(np.asarray(two.came_rad - one.came_rad)))
    return None if abs(between) > _AGAINST_RAD else first_if(between > 0.0)


def turns_across(one: WayIn, two: WayIn) -> Waiting | None:
    """Of two that come towards each other, the one that turns; if both do into one road, the one that turns across."""
    if abs(float(wrap(np.asarray(two.came_rad - one.came_rad)))) <= _AGAINST_RAD:
        return None
    more = abs(one.turned_rad) - abs(two.turned_rad)
    if abs(more) > TURNED_RAD:
        return first_if(more > 0.0)
    turns = sorted((one.turned_rad, two.turned_rad))
    dx, dy = (b - a for a, b in zip(one.begin, two.begin, strict=True))
    side = float(ahead_and_left(np, dx, dy, one.came_rad)[1])
    into_one_road = turns[0] < -TURNED_RAD and turns[1] > TURNED_RAD
    return first_if(one.turned_rad * side > 0.0) if into_one_road and abs(side) > _SIDE_M else None


def waits_by_lights(
    one: Connection | None, two: Connection | Walkway | None, signals: Iterable[Signal], step: int
) -> Waiting | None:
    """Who waits as the lights are at `step`: the one with red, and `g` for `G`; None: they do not tell."""
    if one is None or two is None or one.signal != two.signal:
        return None
    letters = next((signal.letters(step) for signal in signals if signal.id == one.signal), "")
    mine, theirs = (_LIT_RANK.get(letters[light.link : light.link + 1]) for light in (one, two))
    return None if mine is None or theirs is None or mine == theirs else first_if(mine < theirs)


@dataclass(frozen=True)
class Meeting:
    """A way of others that crosses or joins the route.

    `Route.meetings` tell the right of way without the lights, `Observation.meetings_ahead` as it is under them now.
    """

    kind: Literal["crossing", "merge", "pedestrians"]
    lane: str  # the route's lane
    other: str  # the lane, or the crossing for pedestrians, of the others
    begin_m: float  # where along the route their lane is first reached ...
    end_m: float  # ... and where it is left behind; of a merge, where both lanes end
    # whether the ego gives way to them: by SUMO's `request` rows, on other maps by signs and turns; None: not told
    ego_yields: bool | None
    they_yield: bool | None  # whether they give way to the ego
    light: Connection | None = None  # with the light for the ego
    other_light: Connection | Walkway | None = None  # with the light for them

    def under(self, signals: Iterable[Signal], step: int) -> "Meeting":
        """The same as the lights are at `step`: who has red waits, and `g` for `G`; equal lights change nothing."""
        waits = waits_by_lights(self.light, self.other_light, signals, step)
        return self if waits is None else replace(self, ego_yields=waits == "first", they_yield=waits == "second")


class WayMet(NamedTuple):
    """A lane of others that crosses or joins a lane of the route."""

    kind: Literal["crossing", "merge"]
    lane: str
    other: str
    shared: Float[np.ndarray, "point 2"]  # [m] corners of the part of the lane that the other's strip covers
    ego_yields: bool | None  # as in `Meeting`
    they_yield: bool | None


def meetings(
    road: RoadMap, points: Float[np.ndarray, "point 2"], lanes: Mapping[str, tuple[float, float]]
) -> tuple[Meeting, ...]:
    """The meetings, in order, on a route with a point every metre.

    For each of its lanes, `lanes` has the part of the route, from and to [m], on which the lane's meetings are: a route
    may pass a place twice.
    """
    found, line = list[Meeting](), shapely.LineString(points)
    for met in ways_met(road, tuple(lanes)):
        first, last = (int(metres) for metres in lanes[met.lane])
        part = shapely.LineString(points[min(first, len(points) - 2) : last + 2])
        along = first + shapely.line_locate_point(part, shapely.points(met.shared))
        stretch = float(along.min()), float(along.max())
        lights = light_into(road, met.lane), light_into(road, met.other)
        found.append(Meeting(met.kind, met.lane, met.other, *stretch, met.ego_yields, met.they_yield, *lights))
    for name, (begin, _) in lanes.items():
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
            kind = meeting_kind(road, lane, other) if other is not lane else None
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
    told = table.must_yield(lane, other), table.must_yield(other, lane)
    known = {lane, other} <= table.links.keys() and not all(told)  # two that wait for each other never both have green
    return told if known else (None, None)


def _by_signs(road: RoadMap, lane: str, other: str) -> tuple[bool | None, bool | None]:
    """Who gives way by signs and turns; where there are lights, only by turns."""
    if other not in road.lane:
        return None, None
    waits = (turns_across if _are_lit(road, lane, other) else waits_by_signs)(_way_in(road, lane), _way_in(road, other))
    return (None, None) if waits is None else (waits == "first", waits == "second")


def _are_lit(road: RoadMap, *lanes: str) -> bool:
    """Whether there is a light before one of these lanes."""
    return any(link.signal for lane in lanes for link in road.entries[lane])


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
                told = _yields(road, lane.id, way.id)
                yield Meeting("pedestrians", lane.id, way.id, *stretch, *told, light_into(road, lane.id), way)


def light_into(road: RoadMap, name: str) -> Connection | None:
    """The connection with the light for those who come to a lane."""
    passed = set[str]()
    while name not in passed:
        passed.add(name)
        for link in road.entries[name]:
            if link.signal is not None:
                return link
            if road.lane[link.source].junction:  # a way through a junction may be of several lanes
                name = link.source
    return None
